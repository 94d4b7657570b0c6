"""What a case of the sweep is: water of which a formula, an experiment or a finer run is known."""

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

# Words for what a setting may change.
CHANGEABLE = {
    "smoothing": "support",
    "motion_tolerance": "tolerance",
    "cfl": "cfl",
    "shear_relief": "relief",
}
UNIFORM, FIXED, ADAPTIVE = "uniform", "fixed layers", "adaptive layers"
# Steps between passes of adaptation where layers stay as the start gives them.
NEVER = 10**9
# Random velocities [m/s] by which water loses its lattice.
STIR = 0.3
# A layer more, of twice the mass, for every so many times the spacings of two layers (-); the
# coarsest then still lies in bands of two of its spacings.
TWO_LAYERS, PER_LAYER, MOST_LAYERS = 5.0, 1.6, 6


@dataclass(frozen=True)
class Setting:
    """A way to simulate a case; None: the method's default.

    water: UNIFORM, FIXED, ADAPTIVE, or a variant of a shipped scene. fineness: finest spacings over
    the case's length. smoothing: support over spacing. timed: whether its cost is wanted, too.
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
        return min(MOST_LAYERS, max(2, 2 + round(more)))

    @property
    def solver(self) -> dict[str, float]:
        """Parameters of projection that are not the default."""
        names = [name for name in CHANGEABLE if name != "smoothing"]
        return {name: getattr(self, name) for name in names if getattr(self, name) is not None}

    @property
    def changes(self) -> str:
        """What is not the default, in words."""
        known = {text: getattr(self, name) for name, text in CHANGEABLE.items()}
        return ", ".join(f"{text} {value:g}" for text, value in known.items() if value is not None)


@dataclass
class Run:
    """A simulation that is timed, and read at the end of each frame.

    wall [s] is what `simulated` [s] took; others (-): mean number of cores that other processes
    kept busy meanwhile; steps, iterations: of all frames that go() ran; compression, p99 and
    largest are the mean, 99th percentile and maximum over particles of max(rho/rho0 - 1, 0) (-) in
    each frame, rho summed over positions then.
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
        begun, busy = self._begun
        return max(0.0, others_busy() - busy) / max(time.time() - begun, 1e-9)

    def go(
        self,
        seconds: float,
        read: Callable[[], None] = lambda: None,
        gravity: float = tanks.GRAVITY,
        frame: float = tanks.FRAME,
    ) -> None:
        """Frames of `frame` [s] for `seconds` [s] under gravity [m/s^2], read() after each."""
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
            self._look()
            read()

    def _look(self) -> None:
        sim = self.simulation
        sim.measure_density()
        excess = np.maximum(sim.particles.numpy("density") / 1000.0 - 1.0, 0.0)
        self.compression.append(float(excess.mean()))
        self.p99.append(float(np.percentile(excess, 99.0)))
        self.largest.append(float(excess.max()))

    def masses(self) -> np.ndarray:
        """Of the particles, (n,) [kg]."""
        sim = self.simulation
        return np.array([s.mass for s in sim.layers.specs])[sim.particles.numpy("layer")]

    def places(self) -> np.ndarray:
        """Of the particles, (n, 3) [m]."""
        return self.simulation.particles.numpy("x").astype(float)

    def velocities(self) -> np.ndarray:
        """Of the particles, (n, 3) [m/s]."""
        return self.simulation.particles.numpy("v").astype(float)

    def centre(self) -> np.ndarray:
        """Of mass, (3,) [m]."""
        m = self.masses()
        return (m[:, None] * self.places()).sum(axis=0) / m.sum()

    def energy(self, gravity: float = tanks.GRAVITY) -> float:
        """Kinetic and potential [J]."""
        m, x, v = self.masses(), self.places(), self.velocities()
        return float((m * (0.5 * (v**2).sum(axis=1) + gravity * x[:, 1])).sum())

    def costs(self) -> dict[str, float]:
        """What the run took, and its compression (-)."""
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
    """name: of its rows and figure. across: length that `fineness` divides. errors: what each says,
    by name, the one that is drawn first; shares (-). measure(setting) runs it and returns the run,
    errors, and values that converge (units in their names).
    """

    name: str
    title: str
    across: str
    errors: dict[str, str]
    finenesses: tuple[int, ...]
    measure: Callable[[Setting], tuple[Run, dict[str, float]]]
    # Waters that are simulated by each method, those of `classic` at CLASSIC_AT finenesses.
    waters: tuple[str, ...] = (UNIFORM, FIXED, ADAPTIVE)
    classic: tuple[str, ...] = (UNIFORM, FIXED)
    # Finer uniform runs for errors alone, and the values that are compared with the finest.
    references: tuple[int, ...] = ()
    values: tuple[str, ...] = ()
    # Whether its water moves or rests under pressure, so that shear relief matters.
    sheared: bool = False
    # Whether it is in the summary figure, and in a quick sweep more than a single run.
    summary: bool = False

    @property
    def main(self) -> str:
        """The error that is drawn."""
        return next(iter(self.errors))

    def settings(self, quick: bool) -> list[Setting]:
        """The sweep, from cheap to dear."""
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


# The share of shear relief that is swept (docs/method.md, "Shear relief").
RELIEF = 0.9
# What is changed one at a time: support over spacing, share of the motion, spacings in a step.
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
    most_layers: int = MOST_LAYERS,
    **more,
) -> Scene:
    """A box of `size` [m] with bodies of water as in a scene file, finest particles of `spacing`
    [m], each layer of twice the mass of the next finer; most_layers: the most there are, whatever
    the setting; more: sections of the scene."""
    layers = min(setting.layers, most_layers)
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
    """Still water of `depth` [m], `air` [m] above it; the finest spacing is depth over fineness.

    Where the method does not adapt, layers are laid in sheets from fine to coarse, each two of its
    spacings thick.
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
    """A run of the scene; its kernels are compiled."""
    sim = build_simulation(scene)
    sim.warm_up(tanks.FRAME)
    return Run(sim)


def stir(run: Run, seconds: float, start: int = 0) -> None:
    """Breaks the lattice by random velocities, `start` their seed, and runs `seconds` [s] to rest.

    A lattice resists shear until it is broken, and on it all particles have the same kernel sums,
    which hides errors of what is read from them."""
    sim = run.simulation
    v = np.random.default_rng(start).normal(0.0, STIR, (sim.particles.count, 3))
    set_velocity(sim, v)
    run.go(seconds)


def others_busy() -> float:
    """CPU time [s] that processes but this one, and machines on the same host, have taken."""
    every, own = psutil.cpu_times(), psutil.Process().cpu_times()
    idle = every.idle + getattr(every, "iowait", 0.0)
    guests = getattr(every, "guest", 0.0) + getattr(every, "guest_nice", 0.0)  # in user and nice
    return sum(every) - idle - guests - own.user - own.system


def peak_mib() -> float:
    """Largest resident size of this process [MiB]."""
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return most / (2**20 if sys.platform == "darwin" else 2**10)
