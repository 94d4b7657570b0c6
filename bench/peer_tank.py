"""Tank for the comparison with other fluid solvers, and our run of it."""

import math
import time
from dataclasses import dataclass, field

import numpy as np
import taichi as ti

from bench.tanks import FRAME, GRAVITY
from bench.water import Ours, Water
from msph.device import start
from msph.fluid.simulation import Simulation
from msph.measure.bulk import KERNEL_RADIUS, bulk_density
from msph.measure.kernel_density import kernel_density
from msph.scene.build import build_simulation
from msph.scene.quality import LADDER
from msph.scene.schema import Scene

# Inner edges of the tank along x and y [m]; along z the tank is as wide as the block.
LENGTH, HEIGHT = 3.0, 2.0
# Frames between measurements of the bulk density, which take longer than a frame, and start of the
# measurements [s]: before it, the block is still a lattice.
BULK_EVERY, BULK_FROM = 3, 0.1


@dataclass(frozen=True)
class Tank:
    """A block of counts (nx, ny, nz) particles of spacing 1/per_metre [m] in a corner of the
    tank."""

    counts: tuple[int, int, int]
    per_metre: int

    @property
    def spacing(self) -> float:
        """Spacing of the particles [m]."""
        return 1.0 / self.per_metre

    @property
    def particles(self) -> int:
        """Number of particles."""
        return math.prod(self.counts)

    @property
    def size(self) -> tuple[float, float, float]:
        """Edges of the tank [m]."""
        return LENGTH, HEIGHT, self.counts[2] * self.spacing

    def scene(self, layers: int, looser: bool = False) -> Scene:
        """Returns the tank as our scene: uniform (layers = 1), or adaptive layers of mass ratio 2
        with its spacing as the finest. looser: with the time steps and tolerance of the qualities
        small and medium."""
        step = LADDER["medium" if looser else "large"]
        mass = 1000.0 * self.spacing**3
        high = [n * self.spacing for n in self.counts]
        return Scene.model_validate(
            {
                "box": {"size": self.size},
                "layers": [{"mass": mass * 2**k} for k in range(layers)],
                "water": [{"layer": layers - 1, "lo": [0, 0, 0], "hi": high}],
                "adaptation": {"enabled": layers > 1},
                "projection": {"cfl": step.cfl, "motion_tolerance": step.motion_tolerance},
            }
        )


@dataclass
class Run:
    """Result of a run: numbers of particles; simulated and elapsed time [s]; numbers of steps and
    of iterations of the pressure solve; mean solver residual (-) in each frame; mean kernel density
    errors and bulk densities (-), NaN in shallow water (msph.measure)."""

    particles_start: int = 0
    particles_end: int = 0
    simulated: float = 0.0
    wall: float = 0.0
    steps: int = 0
    iterations: int = 0
    residual: list[float] = field(default_factory=list)
    kernel: list[float] = field(default_factory=list)
    bulk: list[float] = field(default_factory=list)
    settings: str = ""

    @property
    def speed(self) -> float:
        """Real-time factor (-)."""
        return self.simulated / self.wall


def ours(tank: Tank, layers: int, looser: bool, arch: str) -> tuple[Ours, str]:
    """Returns our water with compiled kernels, and its settings in words."""
    arch = start(arch)
    sim = build_simulation(tank.scene(layers, looser))
    sim.warm_up(FRAME)
    return Ours(sim), settings(sim, arch)


def run(tank: Tank, water: Water, seconds: float, settings: str) -> Run:
    """Runs the water of a tank for `seconds` [s]; measurements are not timed."""
    found = Run(particles_start=water.count, settings=settings)
    for frame in range(max(1, round(seconds / FRAME))):
        begin = time.perf_counter()
        water.advance(FRAME, GRAVITY)
        found.wall += time.perf_counter() - begin
        found.simulated = water.time
        found.residual.append(float(water.residuals().mean()))
        if frame % BULK_EVERY == 0 and water.time >= BULK_FROM:
            x, spacing = water.positions(), water.spacings()
            found.bulk.append(inner_bulk(x, spacing, tank.size))
            found.kernel.append(kernel_density(x, spacing, tank.size).mean)
    found.particles_end = water.count
    found.steps, found.iterations = water.steps, water.iterations
    return found


def inner_bulk(x: np.ndarray, spacing: np.ndarray, size: tuple[float, float, float]) -> float:
    """Returns the mean bulk density (-) away from surface and walls of particles at x (n, 3) [m]
    with the spacings (n,) [m], each of volume spacing^3.

    Walls count as air: methods keep different distances from walls, and half a spacing of
    difference would change the density by 4 %.
    """
    room = 2.0 * KERNEL_RADIUS * float(spacing.max())
    return bulk_density(x + room, spacing, tuple(length + 2.0 * room for length in size)).mean


def settings(sim: Simulation, arch: str) -> str:
    """Returns the settings that affect speed and error, in words."""
    p, specs = sim.solver.parameters, sim.layers.specs
    masses = " : ".join(f"{s.mass / specs[0].mass:g}" for s in specs)
    return (
        f"{sim.solver.NAME} on {arch}; masses {masses}; M5 spline, support "
        f"{specs[0].smoothing:g} spacings; dt <= {p.longest_step:.3g} s, {p.cfl:g} spacings past "
        f"neighbours and {p.pressure_cfl:g} of sqrt(p/rho), equal steps to the end of a frame of "
        f"1/{1.0 / FRAME:.0f} s; pressure solve to {100 * p.tolerance:g} % of its "
        f"displacements or {100 * p.motion_tolerance:g} % of the motion in at most "
        f"{p.velocity_iterations} iterations, {p.position_iterations} of the position correction; "
        f"viscosity {p.viscosity:g} Pa s; threads: {ti.cfg.cpu_max_num_threads}"
    )
