"""Cases of the sweep: simulations with a reference from a formula, an experiment or a finer run."""

import math
import resource
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import psutil
import taichi as ti

from bench import tanks
from bench.terms import set_velocity
from msph.fluid.external_forces import ExternalForces
from msph.fluid.simulation import Simulation
from msph.scene.build import build_simulation
from msph.scene.schema import Scene

# Labels of the parameters that a setting may change.
CHANGEABLE = {
    "smoothing": "support",
    "motion_tolerance": "tolerance",
    "cfl": "cfl",
    "shear_relief": "relief",
}
UNIFORM, FIXED, ADAPTIVE = "uniform", "fixed layers", "adaptive layers"
# Steps between passes of adaptation if particles keep their initial layer.
NEVER = 10**9
# Standard deviation of the random velocities [m/s] that break up the initial lattice.
STIR = 0.3
# Fineness of two layers, its factor per further layer, and largest number of layers: bands are then
# at least two spacings thick.
TWO_LAYERS, PER_LAYER, MAX_LAYERS = 5.0, 1.6, 6


@dataclass(frozen=True)
class Setting:
    """Settings of a run; None: the default of the method.

    water: UNIFORM, FIXED, ADAPTIVE, or a variant of a shipped scene. fineness: the case's length in
    finest spacings. smoothing: support over spacing. timed: measure the cost, not only the errors.
    """

    method: str = "projection"
    water: str = UNIFORM
    fineness: int = 10
    smoothing: float | None = None
    motion_tolerance: float | None = None
    cfl: float | None = None
    shear_relief: float | None = None
    timed: bool = True

    @property
    def layers(self) -> int:
        """Number of layers."""
        if self.water == UNIFORM:
            return 1
        more = math.log(self.fineness / TWO_LAYERS) / math.log(PER_LAYER)
        return min(MAX_LAYERS, max(2, 2 + round(more)))

    @property
    def solver(self) -> dict[str, float]:
        """Parameters of the projection method that differ from the default."""
        names = [name for name in CHANGEABLE if name != "smoothing"]
        return {name: getattr(self, name) for name in names if getattr(self, name) is not None}

    @property
    def changes(self) -> str:
        """Changes from the default, in words."""
        known = {text: getattr(self, name) for name, text in CHANGEABLE.items()}
        return ", ".join(f"{text} {value:g}" for text, value in known.items() if value is not None)


@dataclass
class Run:
    """A timed simulation with its density errors at the end of each frame.

    wall: elapsed time [s] of `simulated` [s]; others: mean number of cores that other processes
    kept busy (-); steps, iterations: totals of all frames; compression, p99 and largest: mean, 99th
    percentile and maximum over particles of max(rho/rho0 - 1, 0) (-) in each frame, rho computed
    from the positions.
    """

    simulation: Simulation
    wall: float = 0.0
    simulated: float = 0.0
    steps: int = 0
    iterations: int = 0
    compression: list[float] = field(default_factory=list)
    p99: list[float] = field(default_factory=list)
    largest: list[float] = field(default_factory=list)
    _begun: tuple[float, float] = field(default_factory=lambda: (time.time(), others_busy()))

    @property
    def others(self) -> float:
        """Mean number of cores that other processes kept busy since the start (-)."""
        begun, busy = self._begun
        return max(0.0, others_busy() - busy) / max(time.time() - begun, 1e-9)

    def go(
        self,
        seconds: float,
        read: Callable[[], None] = lambda: None,
        gravity: float = tanks.GRAVITY,
        frame: float = tanks.FRAME,
    ) -> None:
        """Runs frames of `frame` [s] for `seconds` [s] under gravity [m/s^2]; read() after each."""
        forces = ExternalForces(gravity=(0.0, -gravity, 0.0))
        for _ in range(max(1, round(seconds / frame))):
            sim = self.simulation
            steps, iterations = sim.steps, sim.iterations
            ti.sync()
            begin = time.perf_counter()
            sim.advance(frame, forces)
            ti.sync()
            self.wall += time.perf_counter() - begin
            self.simulated += frame
            self.steps += sim.steps - steps
            self.iterations += sim.iterations - iterations
            self._record()
            read()

    def _record(self) -> None:
        sim = self.simulation
        sim.measure_density()
        excess = np.maximum(sim.particles.numpy("density") / 1000.0 - 1.0, 0.0)
        self.compression.append(float(excess.mean()))
        self.p99.append(float(np.percentile(excess, 99.0)))
        self.largest.append(float(excess.max()))

    def masses(self) -> np.ndarray:
        """Returns the masses of the particles, (n,) [kg]."""
        sim = self.simulation
        return np.array([s.mass for s in sim.layers.specs])[sim.particles.numpy("layer")]

    def positions(self) -> np.ndarray:
        """Returns the positions of the particles, (n, 3) [m]."""
        return self.simulation.particles.numpy("x").astype(float)

    def velocities(self) -> np.ndarray:
        """Returns the velocities of the particles, (n, 3) [m/s]."""
        return self.simulation.particles.numpy("v").astype(float)

    def centre(self) -> np.ndarray:
        """Returns the centre of mass, (3,) [m]."""
        m = self.masses()
        return (m[:, None] * self.positions()).sum(axis=0) / m.sum()

    def energy(self, gravity: float = tanks.GRAVITY) -> float:
        """Returns the kinetic plus potential energy [J]."""
        m, x, v = self.masses(), self.positions(), self.velocities()
        return float((m * (0.5 * (v**2).sum(axis=1) + gravity * x[:, 1])).sum())

    def costs(self) -> dict[str, float]:
        """Returns the costs of the run and its density errors (-)."""
        sim = self.simulation
        return {
            "wall_per_simulated": self.wall / max(self.simulated, 1e-9),
            "particles": sim.particles.count,
            "peak_mib": peak_mib(),
            "others": self.others,
            "steps": self.steps,
            "iterations_per_step": self.iterations / max(self.steps, 1),
            "compression_mean": float(np.mean(self.compression)),
            "compression_p99": float(np.mean(self.p99)),
            "compression_largest": max(self.largest),
        }


@dataclass(frozen=True)
class Case:
    """A case. name: of its rows and figure. across: length that `fineness` divides. errors: meaning
    of each error (-) by name, the main error first. measure(setting) runs the case and returns the
    run, its errors, and values for self-convergence (units in their names).
    """

    name: str
    title: str
    across: str
    errors: dict[str, str]
    finenesses: tuple[int, ...]
    measure: Callable[[Setting], tuple[Run, dict[str, float]]]
    # Kinds of water for the projection method and for the classic method.
    waters: tuple[str, ...] = (UNIFORM, FIXED, ADAPTIVE)
    classic: tuple[str, ...] = (UNIFORM, FIXED)
    # Finenesses of untimed uniform reference runs, and values compared with the finest of them.
    references: tuple[int, ...] = ()
    values: tuple[str, ...] = ()
    # Also run with shear relief.
    sheared: bool = False
    # Part of the summary figure; otherwise a quick sweep makes a single run.
    summary: bool = False

    @property
    def main(self) -> str:
        """Name of the main error, which is plotted."""
        return next(iter(self.errors))

    def settings(self, quick: bool) -> list[Setting]:
        """Returns the settings of the sweep, coarsest first."""
        richest = self.waters[-1]
        if quick and not self.summary:
            return [Setting(water=richest, fineness=self.finenesses[0])]
        finenesses = self.finenesses[:2] if quick else self.finenesses
        found = [Setting(water=w, fineness=n) for n in finenesses for w in self.waters]
        coarse = finenesses[: 1 if quick else 2]
        found += [Setting("classic", w, n) for n in coarse for w in self.classic]
        if quick:
            return [s for s in found if s.water != FIXED]
        middle = finenesses[len(finenesses) // 2]
        for change in CHANGES:
            found.append(Setting(water=richest, fineness=middle, **change))
        if self.sheared:
            waters = (self.waters[0], richest)
            found += [
                Setting(water=w, fineness=n, shear_relief=RELIEF)
                for n in finenesses
                for w in waters
            ]
        found += [Setting(fineness=n, timed=False) for n in self.references]
        return sorted(found, key=lambda s: s.fineness)


# Value of shear_relief in the sweep (docs/method.md, "Shear relief").
RELIEF = 0.9
# Changes, one at a time: support over spacing, motion tolerance, distance per step in spacings.
CHANGES: tuple[dict[str, float], ...] = (
    {"smoothing": 2.0},
    {"smoothing": 2.2},
    {"motion_tolerance": 0.03},
    {"cfl": 0.8},
)


def scene(
    setting: Setting,
    size: tuple[float, float, float],
    spacing: float,
    water: list[dict],
    max_layers: int = MAX_LAYERS,
    **more,
) -> Scene:
    """Returns a scene: a box of `size` [m], volumes of water as in a scene file, layers with finest
    spacing `spacing` [m] and mass ratio 2, at most `max_layers`; more: sections of the scene."""
    layers = min(setting.layers, max_layers)
    given = {"smoothing": setting.smoothing} if setting.smoothing else {}
    adaptation = {"enabled": layers > 1 and setting.method != "classic"}
    if setting.water == FIXED:
        adaptation["every"] = NEVER
    return Scene.model_validate(
        {
            "method": setting.method,
            "box": {"size": size},
            "layers": [{"mass": 1000.0 * spacing**3 * 2**k, **given} for k in range(layers)],
            "water": [{"layer": layers - 1, **w} for w in water],
            "adaptation": adaptation,
            **more,
            "projection": {**setting.solver, **more.get("projection", {})},
        }
    )


def tank(
    setting: Setting,
    footprint: tuple[float, float],
    depth: float,
    air: float,
    jitter: float = 0.02,
    **more,
) -> Scene:
    """Returns a scene of still water of `depth` [m] with `air` [m] above it; the finest spacing is
    depth over fineness.

    For the classic method, each layer but the coarsest is filled two spacings thick, finest on top.
    """
    x, z = footprint
    spacing, top, water = depth / setting.fineness, depth, []
    layers = setting.layers
    for k in range(layers if setting.method == "classic" else 0):
        thick = 2.0 * spacing * 2.0 ** (k / 3.0)
        low = 0.0 if k == layers - 1 else max(0.0, top - thick)
        if top > low:
            water.append({"layer": k, "lo": [0, low, 0], "hi": [x, top, z]})
        top = low
    water = water or [{"lo": [0, 0, 0], "hi": [x, depth, z]}]
    water = [{**w, "jitter": jitter} for w in water]
    return scene(setting, (x, depth + air, z), spacing, water, **more)


def begin(scene: Scene) -> Run:
    """Returns a run of the scene with compiled kernels."""
    sim = build_simulation(scene)
    sim.warm_up(tanks.FRAME)
    return Run(sim)


def stir(run: Run, seconds: float, start: int = 0) -> None:
    """Breaks up the lattice by random velocities with the seed `start`, and runs `seconds` [s].

    A lattice resists shear, and all its particles have the same kernel sums, which hides errors."""
    sim = run.simulation
    v = np.random.default_rng(start).normal(0.0, STIR, (sim.particles.count, 3))
    set_velocity(sim, v)
    run.go(seconds)


def others_busy() -> float:
    """Returns the CPU time [s] of all other processes and of other virtual machines of the host."""
    every, own = psutil.cpu_times(), psutil.Process().cpu_times()
    idle = every.idle + getattr(every, "iowait", 0.0)
    guests = getattr(every, "guest", 0.0) + getattr(every, "guest_nice", 0.0)  # in user and nice
    return sum(every) - idle - guests - own.user - own.system


def peak_mib() -> float:
    """Returns the peak memory of this process [MiB]."""
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return most / (2**20 if sys.platform == "darwin" else 2**10)
