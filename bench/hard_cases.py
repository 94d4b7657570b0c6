"""Hard cases for solvers: scene, external forces and requirements of each."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from bench import tanks
from msph.fluid.external_forces import ExternalForces, Hand
from msph.fluid.simulation import Simulation
from msph.scene.schema import Scene

DOWN = (0.0, -9.81, 0.0)
# Default spacing, depth of the water, and edge of the cubic box [m].
D, DEPTH, EDGE = 0.04, 0.28, 0.6
MIDDLE = (0.5 * EDGE, 0.5 * DEPTH, 0.5 * EDGE)

Drive = Callable[[float], ExternalForces]


def gravity(x: float, y: float, z: float) -> Drive:
    """Returns a constant gravity [m/s^2]."""
    return lambda time: ExternalForces((x, y, z))


STILL = gravity(*DOWN)


def hand(velocity: tuple[float, float, float]) -> Drive:
    """Returns a hand in the middle that accelerates water to `velocity` [m/s] within a step."""
    return lambda time: ExternalForces(DOWN, Hand(MIDDLE, velocity, (0.1, 0.1, 0.1), 1e4))


def shaken(acceleration: float, rate: float) -> Drive:
    """Returns the gravity in a box that is shaken along x: amplitude of `acceleration` [m/s^2],
    frequency `rate` [Hz]."""

    def at(time: float) -> ExternalForces:
        return ExternalForces((acceleration * math.sin(2.0 * math.pi * rate * time), *DOWN[1:]))

    return at


@dataclass(frozen=True)
class Hard:
    """A hard case.

    what: the requirement in words. scene: arguments of tanks.scene() that differ from those of the
    default cube of water.
    drive: external forces as a function of time [s] for `seconds`, in frames of `frame` [s]; then
    the water rests for 1 s under the gravity `rest` [m/s^2]. change: modifies the simulation before
    the start. classic: run the classic method, too. named: start of the message with which the run
    must end, "" if it must not fail. settles: check the bulk density at the end (for water
    deep enough to measure it). kinetic [J]: limit of the kinetic energy, from the available energy.
    """

    what: str
    scene: dict[str, Any] = field(default_factory=dict)
    drive: Drive = STILL
    seconds: float = 1.0
    frame: float = 1.0 / 60.0
    rest: tuple[float, float, float] = DOWN
    change: Callable[[Simulation], None] | None = None
    classic: bool = False
    named: str = ""
    settles: bool = True
    kinetic: float = math.inf

    def build(self, method: str, seed: int = 0) -> Scene:
        """Returns the scene."""
        usual = {"size": [EDGE] * 3, "finest": D, "layers": 1, "water": block()}
        return tanks.scene(**{**usual, **self.scene}, method=method, seed=seed)


def block(edge: float = EDGE, depth: float = DEPTH) -> list[dict[str, Any]]:
    """Returns water of `depth` [m] in a square box of `edge` [m]."""
    return [{"lo": [0, 0, 0], "hi": [edge, depth, edge]}]


def stacked(ratio: float, fine_on_top: bool) -> dict[str, Any]:
    """Returns a scene with fine particles above coarse particles of `ratio` times their mass, or
    below them."""
    (water,), middle = block(depth=0.32), 0.16
    lower = {**water, "hi": [EDGE, middle, EDGE], "layer": int(fine_on_top)}
    upper = {**water, "lo": [0, middle, 0], "layer": int(not fine_on_top)}
    parts = {"layers": 2, "ratio": ratio, "water": [lower, upper], "adaptation": {"enabled": False}}
    return {"finest": 0.03, **parts}


def column(layers: int) -> dict[str, Any]:
    """Returns a column of water 80 fine spacings deep."""
    edge = 0.12 if layers == 1 else 0.26
    water = block(edge, 1.6)
    return {"size": [edge, 1.9, edge], "finest": 0.02, "layers": layers, "water": water}


ADAPTIVE = {"layers": 2}


def body(**more) -> dict[str, Any]:
    return {"bodies": [more]}


def cube_of(tension: float) -> Hard:
    """Returns the case of a weightless cube of liquid with surface tension [N/m]. Its kinetic
    energy cannot exceed the surface energy lost to a ball of its volume, sigma (6 - (36 pi)^(1/3))
    a^2."""
    a = 0.2
    scene = {
        "water": [{"lo": [0.2, 0.2, 0.2], "hi": [0.4, 0.4, 0.4]}],
        "finest": 0.025,
        "projection": {"tension": tension},
    }
    return Hard(
        "becomes round",
        scene,
        gravity(0.0, 0.0, 0.0),
        seconds=0.1 if tension > 100.0 else 1.0,
        rest=(0.0, 0.0, 0.0),
        kinetic=tension * (6.0 - (36.0 * math.pi) ** (1.0 / 3.0)) * a**2,
    )


def scaled(edge: float) -> dict[str, Any]:
    """Returns the default scene scaled to a box of `edge` [m]."""
    s = edge / EDGE
    return {"size": [edge] * 3, "finest": s * D, "water": block(edge, s * DEPTH)}


def places(make: Callable[[np.ndarray], np.ndarray]) -> Callable[[Simulation], None]:
    """Returns a change that moves the initial particles from x to make(x), (n, 3) [m]."""

    def change(sim: Simulation) -> None:
        sim.initial = {**sim.initial, "x": make(sim.initial["x"].copy()).astype(np.float32)}
        sim.reset()

    return change


def pairs(x: np.ndarray) -> np.ndarray:
    """Moves every second particle to the position of the one before it."""
    x[1::2] = x[0 : 2 * len(x[1::2]) : 2]
    return x


def heap(x: np.ndarray) -> np.ndarray:
    """Moves 1,000 particles to one point."""
    x[:1000] = MIDDLE
    return x


def on_walls(x: np.ndarray) -> np.ndarray:
    """Moves the outermost particles onto walls, edges and corners."""
    low, high = x.min(), x[:, 0].max()
    x[x < low + 1e-4] = 0.0
    for axis in (0, 2):
        x[x[:, axis] > high - 1e-4, axis] = EDGE
    return x


def longer_steps(factor: float) -> Callable[[Simulation], None]:
    """Returns a change that multiplies the limit of the time step by `factor`."""

    def change(sim: Simulation) -> None:
        bound = sim.solver.longest_step
        sim.solver.longest_step = lambda *given, **named: factor * bound(*given, **named)

    return change


# Messages of failed runs: more neighbours than fit into the list; water trapped by a body.
COLLAPSED, TRAPPED = "the water blew up: the neighbours of", "bodies.0 compresses water"
PISTON = {"lo": [-0.5, -0.1, -0.1], "hi": [-0.01, 0.7, 0.7]}
HOUR = 3600.0
BALL = {"centre": list(MIDDLE), "radius": 0.1}

CASES: dict[str, Hard] = {
    "still": Hard("rests", classic=True),
    "column, 80 spacings": Hard("rests", column(1), seconds=2.0),
    "column, six layers": Hard("rests", column(6), seconds=2.0),
    "mass ratio 8, fine on coarse": Hard("rests", stacked(8.0, True), classic=True),
    "mass ratio 8, coarse on fine": Hard("rests", stacked(8.0, False), classic=True),
    "mass ratio 64, fine on coarse": Hard("rests", stacked(64.0, True)),
    "mass ratio 64, coarse on fine": Hard("rests", stacked(64.0, False)),
    "pairs at one position": Hard("pairs separate", change=places(pairs), classic=True),
    "1000 particles at one point": Hard(
        "ends with a message", change=places(heap), classic=True, named=COLLAPSED
    ),
    "on walls, edges, corners": Hard("no leaks", change=places(on_walls), classic=True),
    "upside down": Hard("falls, no leaks", ADAPTIVE, gravity(0.0, 9.81, 0.0)),
    "shaken at 10 g": Hard("no leaks", ADAPTIVE, shaken(98.1, 4.0)),
    "hand of 100 m/s, sideways": Hard("no leaks", drive=hand((100.0, 0, 0)), seconds=0.5),
    "hand of 100 m/s, down": Hard("no leaks", drive=hand((0, -100.0, 0)), seconds=0.5),
    "time steps of 2 times the limit": Hard(
        "stays finite", ADAPTIVE, shaken(9.81, 1.0), change=longer_steps(2.0)
    ),
    "time steps of 5 times the limit": Hard(
        "stays finite", ADAPTIVE, shaken(9.81, 1.0), change=longer_steps(5.0)
    ),
    "a frame of 0.5 s": Hard("continues", ADAPTIVE, frame=0.5, seconds=1.0),
    "piston, slow": Hard(
        "names the trapped water",
        body(**PISTON, velocity=[0.3, 0, 0]),
        seconds=4.0,
        named=TRAPPED,
    ),
    "piston, fast": Hard(
        "names the trapped water",
        body(**PISTON, velocity=[5.0, 0, 0]),
        seconds=1.0,
        named=TRAPPED,
    ),
    "mixer at 20 turns per second": Hard(
        "no leaks",
        body(lo=[0.12, 0.08, 0.26], hi=[0.48, 0.2, 0.34], spin=7200.0),
        seconds=0.5,
        settles=False,  # the mixer does not stop, and the water remains a spray
    ),
    "ball at 50 m/s": Hard(
        "no leaks",
        body(centre=[-0.5, 0.14, 0.3], radius=0.1, velocity=[50, 0, 0]),
        seconds=0.1,
    ),
    "sheet of one particle": Hard("rests", {"water": block(depth=D)}, settles=False, classic=True),
    "spray": Hard(
        "falls",
        {"finest": 0.02},
        change=places(lambda x: (x - x.min()) / np.ptp(x, axis=0) * 0.55 + 0.02),
        settles=False,
    ),
    "one particle": Hard(
        "falls and rests",
        {"water": [{"lo": [0.28, 0.28, 0.28], "hi": [0.32, 0.32, 0.32]}]},
        settles=False,
        classic=True,
    ),
    "capacity used up": Hard(
        "refuses splits",
        {**ADAPTIVE, "adaptation": {"capacity": 820}},
        shaken(9.81, 1.0),
    ),
    "full to the lid": Hard(
        "rests",
        {"size": [EDGE, DEPTH, EDGE]},
        shaken(9.81, 1.0),
        settles=False,
    ),
    "box of 100 m": Hard("rests", scaled(100.0), seconds=2.0),
    "box of 1 mm": Hard("rests", scaled(1e-3), seconds=0.5),
    **{f"tension {sigma:g} N/m": cube_of(sigma) for sigma in (0.072, 10.0, 1000.0)},
    "viscosity 10 Pa s": Hard(
        "rests", {"projection": {"viscosity": 10.0}}, shaken(9.81, 1.0), classic=False
    ),
    "viscosity 1e5 Pa s": Hard("rests", {"projection": {"viscosity": 1e5}}, shaken(9.81, 1.0)),
    "adaptation in every step": Hard(
        "rests",
        {**ADAPTIVE, "adaptation": {"every": 1, "hysteresis": 0.0, "travel": 0.0}},
        shaken(4.0, 1.0),
    ),
    "gravity sideways": Hard("no leaks", ADAPTIVE, gravity(9.81, 0.0, 0.0)),
    "no gravity": Hard(
        "stays", ADAPTIVE, gravity(0.0, 0.0, 0.0), rest=(0.0, 0.0, 0.0), settles=False
    ),
    "gravity of 30 m/s^2": Hard("rests", ADAPTIVE, gravity(0.0, -30.0, 0.0), rest=(0, -30.0, 0)),
    "one hour": Hard(
        "rests, no leaks, no memory growth",
        {"finest": 0.1, "water": block(depth=0.4)},
        shaken(1.0, 0.1),
        seconds=HOUR,
        settles=False,
    ),
}


def short(case: Hard) -> Hard:
    """Returns the case shortened for tests."""
    return replace(case, seconds=min(case.seconds, 0.2))
