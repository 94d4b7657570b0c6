"""Projection method: the solver's step and its time step.

The kernel W_ij = W(r_ij, h_ij) is symmetric, so pair forces are equal and opposite for all masses.
Walls are mirrors. One pressure solve changes velocities; one position correction moves crowded
particles apart and adds no velocity. docs/method.md derives the method.
"""

import math
from typing import Any

import numpy as np

from msph.fluid.adaptivity.adaptation import ATTRIBUTES as ADAPTATION_ATTRIBUTES
from msph.fluid.adaptivity.adaptation import Adaptation
from msph.fluid.adaptivity.bands import AdaptationParameters, band_rows
from msph.fluid.boundary import body_links, openings
from msph.fluid.external_forces import NO_HAND, ExternalForces
from msph.fluid.part import Parts
from msph.fluid.particles import images
from msph.fluid.particles.layers import LayerSpec
from msph.fluid.particles.particles import Attribute
from msph.fluid.projection import density, position_correction, pressure_operator, pressure_solve
from msph.fluid.projection.density import Density
from msph.fluid.projection.discretisation import Discretisation
from msph.fluid.projection.force import Force
from msph.fluid.projection.forces import FORCES
from msph.fluid.projection.inertia_work import InertiaWork
from msph.fluid.projection.parameters import MOTION_FACTOR, ProjectionParameters
from msph.fluid.projection.position_correction import PositionCorrection
from msph.fluid.projection.pressure_operator import PressureOperator
from msph.fluid.projection.pressure_solve import PressureSolve
from msph.fluid.projection.shear_relief import ShearRelief
from msph.fluid.projection.virial_pressure import VirialPressure
from msph.fluid.stages import Stage, no_stage
from msph.launches import data_oriented

# Limit of position corrections before time starts, and the density excess (-) at which they end: a
# larger excess would lift the water later. Water 60 fine spacings deep needs 161.
MAX_ARRANGING_ROUNDS, ARRANGED_EXCESS = 400, 1e-3
# Length of the first step over the longest one (-): no speed or pressure is known before it.
FIRST_STEP_FACTOR = 0.1

# Attributes of every particle beyond the core, without those of forces and adaptation.
ATTRIBUTES = (
    *density.ATTRIBUTES,
    *images.ATTRIBUTES,
    *body_links.ATTRIBUTES,
    *openings.ATTRIBUTES,
    *pressure_operator.ATTRIBUTES,
    *pressure_solve.ATTRIBUTES,
    *position_correction.ATTRIBUTES,
)


@data_oriented
class Projection(Discretisation):
    """Solver of the projection method for the particles of all layers.

    The class attributes are explained in docs/extending.md, "A solver".
    """

    NAME = "projection"
    PARAMETERS = ProjectionParameters
    ADAPTS, HAS_BODIES, HAS_OPENINGS = True, True, True
    LAYER_OPTIONS: tuple[str, ...] = ()
    # At 2.45 both errors are small: narrower kernels resist shear, which makes waves too fast;
    # wider kernels smooth waves, which makes them too slow (docs/method.md, "Density").
    # Below 1.7 too few neighbours keep the particles apart: splashes lose 10 to 38 % of their
    # volume at 1.55 and 1.6, 0.3 to 4 % at 1.7, and still water diverges at 1.5.
    SMOOTHING, MIN_SMOOTHING = 2.45, 1.7
    LIST_MARGIN = 0.0  # every step searches a new list
    PER_ENTRY = 4  # the gradient, and the stiffness under viscosity

    parameters: ProjectionParameters

    def __init__(self, parts: Parts):
        super().__init__(parts)
        self.density = Density(self)
        self.pair_gradient = self.density.pair_gradient
        self.operator, self.virial = PressureOperator(self), VirialPressure(self)
        self.position_correction = PositionCorrection(self)
        self.all_forces = [force(self) for force in FORCES]
        self.forces: list[Force] = []  # forces that the scene enables
        self.pressure_solve = PressureSolve(self)
        self.inertia_work = InertiaWork(self)
        self.built_adaptation = Adaptation(self)
        self.adaptation: Adaptation | None = None  # None in scenes without splits and merges
        self.iterations, self.first_step, self.max_rate = 0, True, 0.0

    def load(
        self, parameters: ProjectionParameters, adaptation: AdaptationParameters | None
    ) -> None:
        """Takes the parameters of a scene whose tables and constants are filled already."""
        self.forces = [force for force in self.all_forces if force.enabled(parameters)]
        self.density.with_stress = ShearRelief.enabled(parameters)
        self.position_correction.load(parameters.position_iterations)
        self.tune(parameters)
        self.adaptation = None
        if adaptation is not None:
            self.adaptation = self.built_adaptation
            self.adaptation.load(adaptation)

    @staticmethod
    def constants_of(
        parameters: ProjectionParameters,
        adaptation: AdaptationParameters | None,
        specs: list[LayerSpec],
    ) -> dict[str, Any]:
        """Returns the constants that only this method reads, by their names in Constants."""
        names = ("cfl", "pressure_cfl", "release", "spray", "largest_shift", "slip")
        found: dict[str, Any] = {name: getattr(parameters, name) for name in names}
        # The stiffness of a pair grows with 1/h: narrower kernels need shorter steps.
        narrow = min(min(s.smoothing for s in specs) / Projection.SMOOTHING, 1.0)
        found["pressure_cfl"] *= narrow
        # Drops under tension have shells of particles, for which the tension is calibrated.
        found["air"] = 0.0 if parameters.tension else 1.0
        found["relaxation"] = position_correction.relaxation(max(s.smoothing for s in specs))
        if adaptation is not None:
            found |= {"hysteresis": adaptation.hysteresis, "settle": adaptation.settle}
        return found

    @staticmethod
    def tables_of(
        adaptation: AdaptationParameters | None, specs: list[LayerSpec]
    ) -> tuple[dict, dict]:
        """Returns this method's columns of the tables by layer and by pair of layers."""
        rows, pairs = density.density_tables(specs)
        if adaptation is not None:
            rows |= band_rows(specs, adaptation)
        return rows, pairs

    @staticmethod
    def attributes(
        parameters: ProjectionParameters | None, adaptive: bool
    ) -> tuple[Attribute, ...]:
        """Returns the attributes that a scene with these parameters uses, beyond the core; without
        parameters, those that any scene may use."""
        used = [f for f in FORCES if parameters is None or f.enabled(parameters)]
        own = (a for force in used for a in force.ATTRIBUTES)
        return (*ATTRIBUTES, *own, *(ADAPTATION_ATTRIBUTES if adaptive else ()))

    @staticmethod
    def list_form(parameters: ProjectionParameters) -> str:
        """Returns the form of the neighbour list."""
        return "pair"

    def reset(self) -> None:
        """Resets the state of the solver after the particles were replaced."""
        self.impulses.clear()
        self.max_rate, self.first_step = 0.0, True
        if self.adaptation:
            self.adaptation.reset()
        self.particles_moved()
        self.grid.refresh()

    def state(self) -> dict[str, float]:
        """Returns the numbers that a checkpoint holds besides the particles."""
        own = {"first": float(self.first_step), "top_rate": self.max_rate}
        return own | (self.adaptation.state() if self.adaptation else {})

    def restore(self, state: dict[str, float]) -> None:
        """Restores the numbers that state() returned."""
        self.first_step, self.max_rate = bool(state["first"]), state["top_rate"]
        if self.adaptation:
            self.adaptation.restore(state)

    def arrange(self) -> None:
        """Assigns layers by depth and moves crowded particles apart, before time starts.

        Where volumes of water touch, their lattices do not match. Before time starts, displacements
        cost no energy.
        """
        unchanged = 0
        if self.adaptation:
            self.adaptation.fill()
            self.particles_moved()
        for _ in range(MAX_ARRANGING_ROUNDS):
            self.measure_density()
            crowded = self.position_correction.find(0.0) > ARRANGED_EXCESS
            if crowded:
                self.position_correction.apply(0.0)
            if self.adaptation:
                # Displacements are small: the list is good enough to split and merge.
                unchanged = 0 if self.adaptation.run(budget=1.0) else unchanged + 1
            self.particles_moved()
            settled = not self.adaptation or unchanged > self.adaptation.parameters.settle
            if settled and not crowded:
                break
        self.impulses.clear()
        if self.adaptation:
            self.adaptation.totals[:] = 0

    def longest_step(self, safety: float = 1.0, external: ExternalForces = NO_HAND) -> float:
        """Returns the largest time step [s], the least of step_bounds(); NaN if one of them is."""
        longest = float(np.min(list(self.step_bounds(safety, external).values())))
        return FIRST_STEP_FACTOR * longest if self.first_step else longest

    def step_bounds(
        self, safety: float = 1.0, external: ExternalForces = NO_HAND
    ) -> dict[str, float]:
        """Returns the bounds of the time step [s] by the parameter that sets them; those by motion
        and pressure, all under "cfl", are divided by `safety`.

        Motion: a particle moves at most cfl spacings past neighbours and walls, and at most
        MOTION_FACTOR times that distance in total; a body, and water that the hand sets in motion,
        move at most cfl of the finest spacings. Pressure: forces are constant within a step, and an
        arrangement under pressure p oscillates at up to about 2 sqrt(p/rho0)/d, d the spacing of a
        particle's pairs; longer steps are unstable.
        """
        distance = self.parameters.cfl * self.layers.finest.spacing
        rate = max(
            self.max_rate,
            self.boundary.top_speed / distance,
            self.openings.top_speed / distance,
            1.0 / external.hand.longest_step(distance),
        )
        bounds = {force.LIMITED_BY: force.longest_step for force in self.forces if force.LIMITED_BY}
        bounds["longest_step"] = self.parameters.longest_step
        return bounds | ({} if rate == 0.0 else {"cfl": 1.0 / (safety * rate)})

    def tune(self, parameters: ProjectionParameters) -> None:
        """Updates the live parameters (msph.parameter)."""
        self.parameters = self.pressure_solve.parameters = parameters
        for force in self.forces:
            force.tune(parameters)

    def step(self, dt: float, external: ExternalForces, stage: Stage = no_stage) -> None:
        """Advances the particles by one time step dt [s] (docs/method.md, "A step").

        Leapfrog: half the drift with the old velocities, then forces and pressures at mid-step,
        then half the drift with the new velocities. Comments state "read -> written"; most parts
        also read layers and constants. Bodies have two poses, BEGIN and END of the half step: drift
        stops particles at END, density and pressure use BEGIN of the second half, at mid-step.
        stage(name) is a context manager around each part, for profiling.
        """
        with stage("drift"):
            self.inertia_work.begin(dt, external)
            self.boundary.move(0.5 * dt)  # time -> body poses at t, t + dt/2, mean velocities
            self.contact.drift(0.5 * dt)  # x, v, poses -> x; v of stopped particles and of bodies
            # v of floating bodies -> v; a release in motion is work of the user
            if release := self.boundary.fall(dt, external):
                self.impulses.add_user(*release)
            self.boundary.move(0.5 * dt)  # time -> body poses at t + dt/2, t + dt, mean velocities
            # poses, forces of the last step -> contacts; v of floating bodies, poses of overlaps
            self.collisions.anticipate(dt)
            self.particles_moved()
        if self.adaptation and self.adaptation.pass_due():
            with stage("adaptation"):
                self.neighbours.refresh()
                self.openings.mark()
                self.adaptation.run()  # x, list -> number, order, and all attributes of particles
                self.particles_moved()
        with stage("neighbours"):
            self.neighbours.refresh()  # x, layer -> order of particles, neighbour list
            self.openings.mark()  # x -> particles of prescribed velocity
        with stage("density"):
            # x, list, poses -> images, links, density, defect, pair gradients, diagonal, air share,
            # pair spacing; with stress also relief
            self.density.refresh()
            # poses, links -> gradients and torques of links in gaps
            self.gaps.push(dt, external)
            self.boundary.redo(0.5 * dt)  # v of floating bodies -> mean velocities
            if not self.parameters.tension:
                # defect -> density correction, density
                self.density.follow_defect(self.particles.count)
        with stage("position correction"):
            self.position_correction.find(dt)  # density, v -> displacements, applied below
        with stage("forces"):
            # Before gravity: the pressure of water at rest undoes the velocities by gravity.
            self.beaches.damp(dt)  # x, v -> v
            self.inertia_work.push(dt, external)  # x, v -> impulse of the inertial forces
            if relief := self.force(ShearRelief):
                relief.fitting_step = 1.0 / self.max_rate if self.max_rate else math.inf
            for force in self.forces:
                force.apply(dt, external)  # x, v, last pressures -> v
        with stage("pressure"):
            self.openings.prescribe()  # speeds of inflows -> v in their zones
            # v, density, displacements -> right-hand side; last two pressures -> initial guess
            self.pressure_solve.build_rhs(self.particles.count, dt)
            self.iterations = self.pressure_solve.solve(dt)  # right-hand side, v -> multipliers
            # multipliers, v -> pressure, stress, v of particles and floating bodies
            pressure_rate = self.pressure_solve.accelerate(dt, external)
            self.collisions.resolve()  # contacts, v of floating bodies -> v
            self.boundary.redo(0.5 * dt)  # v of floating bodies -> poses at t + dt
        with stage("drift"):
            # displacements, x, v -> x, v, bounds of the next step by motion
            motion_rate, distance = self.position_correction.apply(dt)
            self.openings.prescribe()  # speeds of inflows -> v in their zones
            self.max_rate = max(pressure_rate, motion_rate)  # bounds the next step
            if self.adaptation:
                self.adaptation.travelled += distance
            self.contact.drift(0.5 * dt)  # x, v, poses -> x, v, as above
            self.inertia_work.end(dt, external)
            self.particles_moved()
        self.first_step = False

    def particles_added(self, speed: float) -> None:
        """Accounts for new particles, of at most `speed` [m/s]."""
        rate = speed / (MOTION_FACTOR * self.parameters.cfl * self.layers.finest.spacing)
        self.max_rate = max(self.max_rate, rate)
        if self.adaptation:
            self.adaptation.number_after(int(self.particles.numpy("id").max()))
        self.particles_moved()
        self.grid.refresh()

    def force(self, kind: type) -> Any:
        """Returns the enabled force of class `kind`, or None."""
        return next((force for force in self.forces if isinstance(force, kind)), None)

    def measure_density(self, stage: Stage = no_stage) -> None:
        """Computes the densities at the particles' current positions."""
        with stage("neighbours"):
            self.neighbours.refresh()
            self.openings.mark()
        with stage("density"):
            self.density.refresh()

    def particles_moved(self) -> None:
        """Invalidates the neighbour list and the grid."""
        self.neighbours.moved(math.inf)
        self.grid.invalidate()
