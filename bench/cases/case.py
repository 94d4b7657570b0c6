"""Cases of the sweep: simulations with a reference from a formula, an experiment or a finer run."""

import math
import resource
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import psutil

from bench import tanks
from bench.peer_splishsplash import Dfsph
from bench.water import Ours, Water
from msph.fluid.simulation import Simulation
from msph.scene.build import build_simulation
from msph.scene.schema import Scene

# Labels of the parameters that a setting may change.
CHANGEABLE = {
    "smoothing": "support",
    "motion_tolerance": "tolerance",
    "cfl": "cfl",
    "shear_relief": "relief",
    "viscosity": "viscosity",
    "longest_step": "dt",
}
# Name of the method DFSPH of SPlisHSPlasH, in addition to our methods.
DFSPH = "DFSPH"
UNIFORM, FIXED, ADAPTIVE = "uniform", "fixed layers", "adaptive layers"
# Steps between passes of adaptation if particles keep their initial layer.
NEVER = 10**9
# Frames between measurements of the kernel density error.
KERNEL_EVERY = 10
# Standard deviation of the random velocities [m/s] that break up the initial lattice.
STIR = 0.3
# Resolution of two layers, its factor per further layer, and largest number of layers: bands are
# then at least two spacings thick.
TWO_LAYERS, PER_LAYER, MAX_LAYERS = 5.0, 1.6, 6


@dataclass(frozen=True)
class Setting:
    """Settings of a run; None: the default of the method.

    water: UNIFORM, FIXED, ADAPTIVE, or a variant of a shipped scene. resolution: the case's length
    in finest spacings. smoothing: support over spacing. For DFSPH motion_tolerance is the mean
    density error in % and cfl its factor; viscosity [m^2/s] and longest_step [s] are of DFSPH only.
    start: seed of the initial displacements. timed: measure the cost, not only the errors.
    """

    method: str = "projection"
    water: str = UNIFORM
    resolution: int = 10
    smoothing: float | None = None
    motion_tolerance: float | None = None
    cfl: float | None = None
    shear_relief: float | None = None
    viscosity: float | None = None
    longest_step: float | None = None
    start: int = 0
    timed: bool = True

    @property
    def layers(self) -> int:
        """Number of layers."""
        if self.water == UNIFORM:
            return 1
        more = math.log(self.resolution / TWO_LAYERS) / math.log(PER_LAYER)
        return min(MAX_LAYERS, max(2, 2 + round(more)))

    @property
    def solver(self) -> dict[str, float]:
        """Parameters of the solver that differ from the default."""
        names = [name for name in CHANGEABLE if name != "smoothing"]
        return {name: getattr(self, name) for name in names if getattr(self, name) is not None}

    @property
    def changes(self) -> str:
        """Changes from the default, in words."""
        known = {text: getattr(self, name) for name, text in CHANGEABLE.items()}
        return ", ".join(f"{text} {value:g}" for text, value in known.items() if value is not None)


@dataclass
class Run:
    """Timed run of water, with its density errors.

    wall, cpu: elapsed and processor time [s] of `simulated` [s]; others: mean number of cores that
    other processes kept busy (-); steps, iterations: totals of all frames; residuals: mean, 99th
    percentile and maximum of the solver residual (-) in each frame; kernel: mean and 99th
    percentile of the kernel density error (-), every KERNEL_EVERY frames.
    """

    water: Water
    wall: float = 0.0
    cpu: float = 0.0
    simulated: float = 0.0
    steps: int = 0
    iterations: int = 0
    residuals: list[tuple[float, float, float]] = field(default_factory=list)
    kernel: list[tuple[float, float]] = field(default_factory=list)
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
        water = self.water
        for _ in range(max(1, round(seconds / frame))):
            steps, iterations = water.steps, water.iterations
            begin, busy = time.perf_counter(), time.process_time()
            water.advance(frame, gravity)
            self.wall += time.perf_counter() - begin
            self.cpu += time.process_time() - busy
            self.simulated += frame
            self.steps += water.steps - steps
            self.iterations += water.iterations - iterations
            self._record()
            read()

    def _record(self) -> None:
        excess = self.water.residuals()
        self.residuals.append((excess.mean(), np.percentile(excess, 99.0), excess.max()))
        if len(self.residuals) % KERNEL_EVERY == 1:
            found = self.water.kernel_density()
            self.kernel.append((found.mean, found.p99))

    @property
    def simulation(self) -> Simulation:
        """The simulation of a run of this program."""
        assert isinstance(self.water, Ours)
        return self.water.simulation

    def costs(self) -> dict[str, float]:
        """Returns the costs of the run and its density errors (-)."""
        residual, p99, largest = np.array(self.residuals).T
        kernel, kernel_p99 = np.mean(self.kernel, axis=0)
        return {
            "wall_per_simulated": self.wall / max(self.simulated, 1e-9),
            "particles": self.water.count,
            "peak_mib": peak_mib(),
            "others": self.others,
            "steps": self.steps,
            "iterations_per_step": self.iterations / max(self.steps, 1),
            "solver_residual_mean": float(residual.mean()),
            "solver_residual_p99": float(p99.mean()),
            "solver_residual_max": float(largest.max()),
            "kernel_density_error_mean": float(kernel),
            "kernel_density_error_p99": float(kernel_p99),
        }


@dataclass(frozen=True)
class Case:
    """A case of the sweep. name: of its rows and figure. across: length that `resolution` divides.
    errors: meaning of each error (-) by name, the main error first. measure(setting) runs the case
    and returns the run, its errors, and values for self-convergence (units in their names).
    """

    name: str
    title: str
    across: str
    errors: dict[str, str]
    resolutions: tuple[int, ...]
    measure: Callable[[Setting], tuple[Run, dict[str, float]]]
    # Kinds of water for the projection method and for the classic method.
    kinds: tuple[str, ...] = (UNIFORM, FIXED, ADAPTIVE)
    classic: tuple[str, ...] = (UNIFORM, FIXED)
    # Resolutions of untimed uniform reference runs, and values compared with the finest of them.
    references: tuple[int, ...] = ()
    values: tuple[str, ...] = ()
    # Changes of the setting with which every resolution runs, too.
    varied: tuple[dict[str, float], ...] = ()
    # Errors in the summary figure; without one, the settings of the solver are not varied.
    summary: tuple[str, ...] = ()
    # Note for the reader about the main error.
    note: str = ""
    # Errors compared with SPlisHSPlasH; empty if SPlisHSPlasH does not run the case.
    peer: tuple[str, ...] = ()

    @property
    def main(self) -> str:
        """Name of the main error, which is plotted."""
        return next(iter(self.errors))

    def settings(self) -> list[Setting]:
        """Returns the settings of the sweep, coarsest first."""
        resolutions, richest = self.resolutions, self.kinds[-1]
        found = [Setting(water=w, resolution=n) for n in resolutions for w in self.kinds]
        found += [Setting("classic", w, n) for n in resolutions[:2] for w in self.classic]
        middle = resolutions[len(resolutions) // 2]
        kinds = tuple(dict.fromkeys((self.kinds[0], richest)))
        for change in CHANGES if self.summary else ():
            found += [Setting(water=w, resolution=middle, **change) for w in kinds]
        if self.peer:
            found += [
                Setting(DFSPH, UNIFORM, n, viscosity=nu) for n in resolutions for nu in (None, 0.0)
            ]
            found += [Setting(DFSPH, UNIFORM, middle, **change) for change in PEER_CHANGES]
        for change in self.varied:
            found += [Setting(water=w, resolution=n, **change) for n in resolutions for w in kinds]
        found += [Setting(resolution=n, timed=False) for n in self.references]
        return sorted(found, key=lambda s: s.resolution)


# Share of the velocities that a frame of 1/60 s leaves after stirring (-): about the critical
# damping of the waves of a tank 0.5 m wide.
CALM = 0.8
# Settings of DFSPH at one resolution, in addition to its shipped ones and to zero viscosity.
PEER_CHANGES: tuple[dict[str, float], ...] = (
    {"viscosity": 0.001},
    {"viscosity": 0.0, "longest_step": 0.0025},
    {"viscosity": 0.0, "cfl": 0.5},
    {"viscosity": 0.0, "motion_tolerance": 0.01},
    {"viscosity": 0.001, "motion_tolerance": 0.01, "longest_step": 0.0025},
)
# Change of runs that keep the numerical friction (docs/method.md, "Shear relief").
UNSHEARED = {"shear_relief": 0.0}
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
    peer = setting.method == DFSPH
    adaptation: dict[str, float] = {"every": NEVER} if setting.water == FIXED else {}
    if setting.method == "classic":
        adaptation["enabled"] = False
    terms = {**({} if peer else setting.solver), **more.pop("projection", {})}
    return tanks.scene(
        size,
        spacing,
        min(setting.layers, max_layers),
        water,
        smoothing=setting.smoothing,
        adaptation=adaptation,
        method="projection" if peer else setting.method,
        seed=setting.start,
        projection=terms,
        **more,
    )


def tank(
    setting: Setting,
    footprint: tuple[float, float],
    depth: float,
    air: float,
    jitter: float | None = None,
    **more,
) -> Scene:
    """Returns a scene of still water of `depth` [m] with `air` [m] above it; the finest spacing is
    depth over resolution.

    For the classic method, each layer but the coarsest is filled two spacings thick, finest on top.
    """
    x, z = footprint
    spacing, top, water = depth / setting.resolution, depth, []
    layers = setting.layers
    for k in range(layers if setting.method == "classic" else 0):
        thick = 2.0 * spacing * 2.0 ** (k / 3.0)
        low = 0.0 if k == layers - 1 else max(0.0, top - thick)
        if top > low:
            water.append({"layer": k, "lo": [0, low, 0], "hi": [x, top, z]})
        top = low
    water = water or [{"lo": [0, 0, 0], "hi": [x, depth, z]}]
    if jitter is not None:
        water = [{**w, "jitter": jitter} for w in water]
    return scene(setting, (x, depth + air, z), spacing, water, **more)


def begin(setting: Setting, scene: Scene) -> Run:
    """Returns a run of the scene by our solver, with compiled kernels, or by DFSPH."""
    if setting.method == DFSPH:
        changes = dict(setting.solver)
        if "motion_tolerance" in changes:
            changes["tolerance"] = changes.pop("motion_tolerance")
        return Run(Dfsph(scene, **changes))
    sim = build_simulation(scene)
    sim.warm_up(tanks.FRAME)
    return Run(Ours(sim))


def stir(run: Run, seconds: float, start: int) -> None:
    """Breaks up the lattice by random velocities with the seed `start`, and runs `seconds` [s] with
    damped velocities, because waves would persist without damping.

    A lattice resists shear, and all its particles have the same kernel sums, which hides errors."""
    v = np.random.default_rng(start).normal(0.0, STIR, (run.water.count, 3))
    run.water.set_velocities(v)
    run.go(seconds, lambda: run.water.set_velocities(CALM * run.water.velocities()))


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
