"""The projection method: one step, and when time may go on.

Symmetric kernel W_ij = W(r_ij, h_ij), so that every pair force is equal and opposite whatever the
masses; walls are mirrors; one pressure solve for velocities and one correction of positions, which
gives no velocity. docs/method.md derives all of it.
"""

import math
from typing import Any

import taichi as ti

from msph.fluid.adaptivity.adaptation import ATTRIBUTES as ADAPTATION_ATTRIBUTES
from msph.fluid.adaptivity.adaptation import Adaptation, band_rows
from msph.fluid.adaptivity.bands import AdaptationParameters
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
    # Below 1.7 too few neighbours hold the water apart: splashes lose 10 to 38 % of their volume at
    # 1.55 and 1.6, 0.3 to 4 % at 1.7, and still water diverges at 1.5.
    SMOOTHING, MIN_SMOOTHING = 2.45, 1.7
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

    def load(
        self, parameters: ProjectionParameters, adaptation: AdaptationParameters | None
    ) -> None:
        """Takes the parameters of a scene, whose tables and constants are filled already."""
        wanted = [f for f in self.every_force if type(f).wanted(parameters)]
        self.forces, self.adaptation = wanted, None
        self.relieved = ShearRelief.wanted(parameters)
        self.position_correction.load(parameters.position_iterations)
        self.tune(parameters)
        if adaptation is not None:
            self.adaptation = self.adapting
            self.adaptation.load(adaptation)

    @staticmethod
    def constants_of(
        parameters: ProjectionParameters,
        adaptation: AdaptationParameters | None,
        specs: list[LayerSpec],
    ) -> dict[str, Any]:
        """Constants of a scene that only this method reads, by their names in Constants."""
        names = ("cfl", "pressure_cfl", "release", "spray", "largest_shift", "slip")
        found: dict[str, Any] = {name: getattr(parameters, name) for name in names}
        found["relaxation"] = position_correction.relaxation(max(s.smoothing for s in specs))
        if adaptation is not None:
            found |= {"hysteresis": adaptation.hysteresis, "settle": adaptation.settle}
        return found

    @staticmethod
    def tables_of(
        adaptation: AdaptationParameters | None, specs: list[LayerSpec]
    ) -> tuple[dict, dict]:
        """Columns of the tables by layer and by pair of layers that only this method reads."""
        rows, pairs = density.density_tables(specs)
        if adaptation is not None:
            rows |= band_rows(specs, adaptation)
        return rows, pairs

    @staticmethod
    def all_attributes() -> tuple[Attribute, ...]:
        """All attributes that any scene may use, beyond the core."""
        own = (a for force in forces.FORCES for a in force.ATTRIBUTES)
        return (*ATTRIBUTES, *own, *ADAPTATION_ATTRIBUTES)

    @staticmethod
    def attributes(parameters: ProjectionParameters, adaptive: bool) -> tuple[Attribute, ...]:
        """Attributes that a scene with these parameters uses, beyond the core."""
        own = (a for force in forces.wanted(parameters) for a in force.ATTRIBUTES)
        return (*ATTRIBUTES, *own, *(ADAPTATION_ATTRIBUTES if adaptive else ()))

    @staticmethod
    def list_form(parameters: ProjectionParameters) -> str:
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
            self.adaptation.totals[:] = 0

    def longest_step(self, safety: float = 1.0) -> float:
        """Largest time step [s] now, `safety` times as short as motion and pressure allow.

        No particle moves farther than cfl of its spacing past its neighbours and walls, nor farther
        than LEAP times as much. And forces are constant within a step, while an arrangement under
        the pressure p swings at up to about 2 sqrt(p/rho0)/d, d the spacing of a particle's pairs:
        longer steps make deep fine water boil and collapse, however well each step converges.
        """
        # Nor may a body overtake the water that it pushes.
        body = self.boundary.top_speed / (self.parameters.cfl * self.layers.finest.spacing)
        rate = max(self.top_rate, body)
        bound = 1.0 / (safety * rate) if rate > 0.0 else self.parameters.longest_step
        stable = min(force.longest_step for force in self.forces)
        longest = min(bound, self.parameters.longest_step, stable)
        return FIRST_STEP * longest if self.first else longest

    def tune(self, parameters: ProjectionParameters) -> None:
        """Takes over those parameters that are live (msph.parameter)."""
        self.parameters = self.pressure_solve.parameters = parameters
        for force in self.forces:
            force.tune(parameters)

    def step(self, dt: float, external: ExternalForces, stage: Stage = no_stage) -> None:
        """Advances the particles by one time step dt [s]; docs/method.md, "A step", has this box.

        Leapfrog: half the drift with the old velocities, forces and pressures at mid-step, half the
        drift with the new velocities. Each line says: what is read -> what is written. stage(name)
        is entered around each part, as the hook of a profiler.
        """
        with stage("drift"):
            self.boundary.move(0.5 * dt)  # body poses and velocities at t, at t + dt/2
            self.contact.drift(0.5 * dt)  # x, v -> x; v where walls and bodies stop particles
            self.boundary.move(0.5 * dt)  # body poses and velocities at t + dt/2, at t + dt
            self.particles_moved()
        if self.adaptation and self.adaptation.pass_due():
            with stage("adaptation"):
                self.neighbours.refresh()
                self.adaptation.run()  # x, v, layer, neighbours -> all attributes: split, merged
                self.particles_moved()
        with stage("neighbours"):
            self.neighbours.refresh()  # x, layer -> order of all attributes, neighbour list
        with stage("density"):
            self.density.refresh()  # x, list -> density, pair gradients, diagonal
            if not self.parameters.tension:
                self.density.follow_defect(self.particles.count)  # density -> density correction
        with stage("position correction"):
            self.position_correction.find(dt)  # density, v -> displacements, applied below
        with stage("forces"):
            for force in self.forces:
                # v -> v; ShearRelief also reads the stress of the previous step.
                force.apply(dt, external)
        with stage("pressure"):
            # v, density, displacements -> rhs, multipliers of the previous steps as a start
            self.pressure_solve.build_rhs(self.particles.count, dt)
            self.iterations = self.pressure_solve.solve(dt)  # rhs, start -> multipliers
            # multipliers -> v, pressure, stress
            pressing = self.pressure_solve.accelerate(dt, external.gravity, self.relieved)
        with stage("drift"):
            self.position_correction.apply()  # displacements -> x, v, relative speeds
            moving, way = self._fastest(self.particles.count, dt)
            self.top_rate = max(pressing, moving)  # bounds the next step
            if self.adaptation:
                self.adaptation.travelled += way
            self.contact.drift(0.5 * dt)  # x, v -> x, v
            self.particles_moved()
        self.first = False

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
    def _fastest(self, n: ti.i32, dt: ti.f32) -> ti.math.vec2:
        """Largest rate [1/s] by which motion bounds the next step, speed over cfl spacings; and the
        farthest way of a particle in dt [s], in spacings."""
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
        return ti.Vector([top, longest])
