"""The projection method: one step, and when time may go on.

Symmetric kernel W_ij = W(r_ij, h_ij), so that every pair force is equal and opposite whatever the
masses; walls are mirrors; one pressure solve for velocities and one correction of positions, which
gives no velocity. docs/method.md derives all of it.
"""

import math
from typing import Any

import taichi as ti

from msph.fluid.adaptivity import adaptation
from msph.fluid.adaptivity.adaptation import Adaptation
from msph.fluid.boundary import contact
from msph.fluid.external_forces import ExternalForces
from msph.fluid.particles.layers import LayerSpec
from msph.fluid.particles.particles import Attribute
from msph.fluid.parts import Parts
from msph.fluid.projection import (
    density,
    forces,
    position_correction,
    pressure_operator,
    pressure_solve,
)
from msph.fluid.projection.density import Density
from msph.fluid.projection.discretisation import Discretisation
from msph.fluid.projection.parameters import LEAP, ProjectionParameters
from msph.fluid.projection.position_correction import PositionCorrection
from msph.fluid.projection.pressure_operator import PressureOperator
from msph.fluid.projection.pressure_solve import PressureSolve
from msph.fluid.projection.shear_relief import ShearRelief
from msph.fluid.stages import Stage, no_stage
from msph.taichi_internals import data_oriented, kernel

# Rounds of position correction before time starts, at most, and the density excess (-) that they
# may leave: what is left lifts the water later. 60 fine sheets of halved cubes take 161.
ARRANGING, ARRANGED = 400, 1e-3
# The same as LEAP for spray, which has no neighbours to pass.
SPRAY_LEAP = 2.5
# Share (-) of the longest step that the first takes, before any speed or pressure is known.
FIRST_STEP = 0.1

# Attributes of every particle beyond the core; forces and adaptation have theirs.
ATTRIBUTES = (
    *density.ATTRIBUTES,
    *contact.ATTRIBUTES,
    *pressure_operator.ATTRIBUTES,
    *pressure_solve.ATTRIBUTES,
    *position_correction.ATTRIBUTES,
)


@data_oriented
class Projection:
    """One solver over the particles of all layers."""

    NAME = "projection"
    PARAMETERS = ProjectionParameters
    # Its particles may split and merge; bodies and containers may hold the water.
    ADAPTS, HAS_BODIES = True, True
    # Options of a layer that it heeds, beyond its size.
    LAYER_OPTIONS: tuple[str, ...] = ()
    # Support over spacing: narrower kernels are stiff against shear and make waves fast, wider ones
    # smooth them and make them slow; at 2.45 both are small (docs/method.md, "Kernel").
    SMOOTHING = 2.45
    # Margin of the neighbour list, in supports: the list is made anew in every step.
    LIST_MARGIN = 0.0
    # Numbers stored beside each neighbour: its gradient.
    PER_ENTRY = 3
    MIRRORS = True

    parameters: ProjectionParameters

    def __init__(self, parts: Parts):
        self.constants, self.boundary, self.contact = parts.constants, parts.boundary, parts.contact
        self.layers, self.grid, self.particles = parts.layers, parts.grid, parts.particles
        self.neighbours, self.impulses = parts.neighbours, parts.impulses
        self.density = Density(
            parts.constants, parts.contact, parts.layers, parts.particles, parts.neighbours
        )
        operator = PressureOperator(
            parts.layers, parts.particles, parts.neighbours, self.density.pair_gradient
        )
        shared = Discretisation(
            constants=parts.constants,
            boundary=parts.boundary,
            contact=parts.contact,
            layers=parts.layers,
            particles=parts.particles,
            neighbours=parts.neighbours,
            density=self.density,
            operator=operator,
            impulses=parts.impulses,
        )
        self.position_correction = PositionCorrection(shared)
        self.every_force: list[Any] = [force(shared) for force in forces.FORCES]
        self.forces: list[Any] = []
        self.pressure_solve = PressureSolve(shared)
        self.adapting = Adaptation(parts.room, shared)
        self.adaptation: Any = None  # where particles split and merge
        self.iterations, self.first, self.top_rate = 0, True, 0.0

    def load(self, parameters: ProjectionParameters) -> None:
        """Takes the parameters of a scene, whose tables and constants are filled already."""
        wanted = [f for f in self.every_force if type(f).wanted(parameters)]
        self.forces, self.adaptation = wanted, None
        self.relieved = ShearRelief.wanted(parameters)
        self.position_correction.load(parameters.position_iterations)
        self.tune(parameters)
        if parameters.adaptation is not None:
            self.adaptation = self.adapting
            self.adaptation.load(parameters.adaptation)

    @staticmethod
    def constants_of(parameters: ProjectionParameters, specs: list[LayerSpec]) -> dict[str, Any]:
        """Constants of a scene that only this method reads, by their names in Constants."""
        names = ("cfl", "pressure_cfl", "release", "spray", "largest_shift", "slip")
        found: dict[str, Any] = {name: getattr(parameters, name) for name in names}
        found["relaxation"] = position_correction.relaxation(max(s.smoothing for s in specs))
        if parameters.adaptation is not None:
            found["hysteresis"] = parameters.adaptation.hysteresis
            found["settle"] = parameters.adaptation.settle
        return found

    @staticmethod
    def tables_of(parameters: ProjectionParameters, specs: list[LayerSpec]) -> tuple[dict, dict]:
        """Columns of the tables by layer and by pair of layers that only this method reads."""
        rows, pairs = density.density_tables(specs)
        if parameters.adaptation is not None:
            rows |= adaptation.band_rows(specs, parameters.adaptation)
        return rows, pairs

    @staticmethod
    def every_attribute() -> tuple[Attribute, ...]:
        """All attributes that any scene may use, beyond the core."""
        own = (a for force in forces.FORCES for a in force.ATTRIBUTES)
        return (*ATTRIBUTES, *own, *adaptation.ATTRIBUTES)

    @staticmethod
    def attributes(parameters: ProjectionParameters) -> tuple[Attribute, ...]:
        """Attributes that a scene with these parameters uses, beyond the core."""
        own = (a for force in forces.wanted(parameters) for a in force.ATTRIBUTES)
        adaptive = adaptation.ATTRIBUTES if parameters.adaptation else ()
        return (*ATTRIBUTES, *own, *adaptive)

    @staticmethod
    def reach(parameters: ProjectionParameters) -> str:
        """Form of the neighbour list."""
        return "pair"

    def reset(self) -> None:
        """Forgets what it knew of the particles: they were replaced."""
        self.impulses.clear()
        self.top_rate, self.first = 0.0, True
        if self.adaptation:
            self.adaptation.reset()
        self.particles_moved()
        self.grid.refresh()

    def state(self) -> dict[str, float]:
        """What a checkpoint holds beside the particles; see restore()."""
        own = {"first": float(self.first), "top_rate": self.top_rate}
        return own | (self.adaptation.state() if self.adaptation else {})

    def restore(self, state: dict[str, float]) -> None:
        """Goes on from a state()."""
        self.first, self.top_rate = bool(state["first"]), state["top_rate"]
        if self.adaptation:
            self.adaptation.restore(state)

    def arrange(self) -> None:
        """Gives each depth its layer, and moves particles apart that the scene placed too near:
        bodies of water that touch have lattices that do not fit. At time zero it costs no energy.
        """
        unchanged = 0
        if self.adaptation:
            self.adaptation.fill()
            self.particles_moved()
        for _ in range(ARRANGING):
            self.neighbours.refresh()
            self.density.refresh()
            crowded = self.position_correction.find(0.0) > ARRANGED
            if crowded:
                self.position_correction.apply()
            self.particles_moved()
            if self.adaptation:
                unchanged = 0 if self.adaptation.run(budget=1.0) else unchanged + 1
            settled = not self.adaptation or unchanged > self.adaptation.parameters.settle
            if settled and not crowded:
                break
        self.impulses.clear()
        if self.adaptation:
            self.adaptation.passed[:] = 0

    def longest_step(self, leeway: float = 1.0) -> float:
        """Largest time step [s] now, `leeway` times as short as motion and pressure allow.

        No particle moves farther than cfl of its spacing past its neighbours and walls, nor farther
        than LEAP times as much. And forces are constant within a step, while an arrangement under
        the pressure p swings at up to about 2 sqrt(p/rho0)/d, d the spacing of a particle's pairs:
        longer steps make deep fine water boil and collapse, however well each step converges.
        """
        # Nor may a body overtake the water that it pushes.
        body = self.boundary.top_speed / (self.parameters.cfl * self.layers.finest.spacing)
        rate = max(self.top_rate, body)
        bound = 1.0 / (leeway * rate) if rate > 0.0 else self.parameters.longest_step
        stable = min(force.longest_step for force in self.forces)
        longest = min(bound, self.parameters.longest_step, stable)
        return FIRST_STEP * longest if self.first else longest

    def tune(self, parameters: ProjectionParameters) -> None:
        """Takes over those parameters that are live (msph.parameter)."""
        self.parameters = self.pressure_solve.parameters = parameters
        for force in self.forces:
            force.tune(parameters)

    def step(self, dt: float, external: ExternalForces, stage: Stage = no_stage) -> None:
        """One step of dt [s]; stage(name) is entered round each part, as a profiler's hook.

        Leapfrog: half the way by the old velocities, forces and pressures there, and half the way
        by the new ones. Positions are of second order in dt, and what compression a step leaves,
        quadratic in its length, is a quarter at its end.
        """
        with stage("advance"):
            self.boundary.move(0.5 * dt)
            self._drift(0.5 * dt)
            self.boundary.move(0.5 * dt)
        if self.adaptation and self.adaptation.due():
            with stage("adaptation"):
                self.adapt()
        with stage("neighbours"):
            self.neighbours.refresh()
        with stage("density"):
            self.density.refresh()
            if not self.parameters.tension:
                self.density.follow_defect(self.particles.count)
        with stage("position correction"):
            self.position_correction.find(dt)
        with stage("forces"):
            for force in self.forces:
                force.apply(dt, external)
        with stage("pressure"):
            self.iterations = self.pressure_solve.solve(dt)
        with stage("advance"):
            self.advance(dt, external.gravity)
        self.first = False

    def adapt(self) -> None:
        """Splits and merges, before a step: what a split crowds is corrected within the step."""
        self.neighbours.refresh()
        self.adaptation.run()
        self.particles_moved()

    def advance(self, dt: float, gravity: tuple[float, float, float]) -> None:
        """Velocities by the pressures found, positions by correction and velocities."""
        by_pressure = self.pressure_solve.accelerate(dt, gravity, self.relieved)
        self.position_correction.apply()
        self.top_rate = max(by_pressure, self._top_rate(self.particles.count, dt))
        self._drift(0.5 * dt)

    def _drift(self, dt: float) -> None:
        """Particles by their velocities for dt [s], to where bodies stand at the end of it."""
        self.contact.drift(dt)
        self.particles_moved()

    def force(self, kind: type) -> Any:
        """The solver's force of that class, None where the scene has none."""
        return next((force for force in self.forces if isinstance(force, kind)), None)

    def measure_density(self, stage: Stage = no_stage) -> None:
        """Densities of the particles where they are now."""
        with stage("neighbours"):
            self.neighbours.refresh()
        with stage("density"):
            self.density.refresh()

    def particles_moved(self) -> None:
        """Tells list and grid."""
        self.neighbours.moved(math.inf)
        self.grid.invalidate()

    @kernel
    def _top_rate(self, n: ti.i32, dt: ti.f32) -> ti.f32:
        """Largest rate [1/s] by which motion bounds the next step: speed over cfl spacings. Adds
        to the way that adaptation has let particles go."""
        p = self.particles
        top, longest = 0.0, 0.0
        for i in range(n):
            spray = self.constants.spray[None] * self.constants.rest_density[None]
            d, speed = self.layers.spacing[p.layer[i]], p.v[i].norm()
            relative = ti.math.clamp(p.relative_speed[i], speed / LEAP, speed)
            if p.predicted_density[i] < spray:
                speed /= SPRAY_LEAP
                relative = speed
            ti.atomic_max(longest, speed * dt / d)
            ti.atomic_max(top, relative / (self.constants.cfl[None] * d))
        self.adapting.travelled[None] += longest
        return top
