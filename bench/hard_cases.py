"""Water as it breaks solvers: what each case is, how it is driven, and what it must keep."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from msph.fluid.external_forces import ExternalForces, Hand
from msph.fluid.simulation import Simulation

DOWN = (0.0, -9.81, 0.0)
# Spacing, and depth of the water, in a cube with this edge [m], unless a case says otherwise.
D, DEPTH, EDGE = 0.04, 0.28, 0.6
MIDDLE = (0.5 * EDGE, 0.5 * DEPTH, 0.5 * EDGE)

Drive = Callable[[float], ExternalForces]


def gravity(x: float, y: float, z: float) -> Drive:
    """A constant gravity [m/s^2]."""
    return lambda time: ExternalForces((x, y, z))


STILL = gravity(*DOWN)


def hand(velocity: tuple[float, float, float]) -> Drive:
    """A hand in the middle that takes the water along at once [m/s]."""
    return lambda time: ExternalForces(DOWN, Hand(MIDDLE, velocity, 0.1, 1e4))


def shaken(acceleration: float, rate: float) -> Drive:
    """The box is shaken along x [m/s^2], so many times a second."""

    def at(time: float) -> ExternalForces:
        return ExternalForces((acceleration * math.sin(2.0 * math.pi * rate * time), *DOWN[1:]))

    return at


@dataclass(frozen=True)
class Hard:
    """what: is demanded, in words. scene: sections beside the usual cube of water. drive: forces
    by time [s] for `seconds`, in frames of `frame` [s]; then comes a second of rest under
    `rest` [m/s^2]. change: done to the simulation first. classic: whether it is simulated by that
    method, too. named: how the line must begin with which a run ends that cannot go on. settles:
    whether densities at the end are demanded, of water that is deep enough to have one. kinetic
    [J]: the most that there may be, by what the water had to give.
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

    def data(self, method: str) -> dict[str, Any]:
        """The scene, as in a file."""
        usual = {
            "method": method,
            "box": {"size": [EDGE] * 3},
            "layers": [{"spacing": D}],
            "water": [{"lo": [0, 0, 0], "hi": [EDGE, DEPTH, EDGE]}],
        }
        found = {**usual, **self.scene}
        if method == "classic":
            found.pop("projection", None)
        return found


def layers(*masses: float, spacing: float = D) -> list[dict[str, float]]:
    """Layers of so many times the mass of particles of `spacing` [m]."""
    return [{"mass": 1000.0 * spacing**3 * m} for m in masses]


def stacked(ratio: float, fine_on_top: bool) -> dict[str, Any]:
    """A sheet of fine particles on coarse ones, or below them."""
    order = (1, 0) if fine_on_top else (0, 1)
    parts = ([0, 0, 0], [EDGE, 0.16, EDGE]), ([0, 0.16, 0], [EDGE, 0.32, EDGE])
    water = [{"layer": k, "lo": lo, "hi": hi} for k, (lo, hi) in zip(order, parts, strict=True)]
    return {"layers": layers(1.0, ratio, spacing=0.03), "water": water}


def column(count: int) -> dict[str, Any]:
    """Water 80 fine spacings deep, of so many layers."""
    edge, d = (0.12, 0.02) if count == 1 else (0.26, 0.02)
    return {
        "box": {"size": [edge, 1.9, edge]},
        "layers": layers(*(2.0**k for k in range(count)), spacing=d),
        "water": [{"layer": count - 1, "lo": [0, 0, 0], "hi": [edge, 1.6, edge]}],
        "adaptation": {"enabled": count > 1},
    }


ADAPTIVE = {
    "layers": layers(1.0, 2.0),
    "water": [{"layer": 1, "lo": [0, 0, 0], "hi": [EDGE, DEPTH, EDGE]}],
    "adaptation": {"enabled": True},
}


def body(**more) -> dict[str, Any]:
    return {"obstacles": [more]}


def cube_of(tension: float) -> Hard:
    """A weightless cube of liquid with surface tension [N/m]: it may turn into motion the surface
    that a ball of its volume has less, (6 - (36 pi)^(1/3)) a^2, and no more."""
    a = 0.2
    scene = {
        "water": [{"lo": [0.2, 0.2, 0.2], "hi": [0.4, 0.4, 0.4]}],
        "layers": layers(1.0, spacing=0.025),
        "projection": {"tension": tension},
    }
    return Hard(
        "rounds itself",
        scene,
        gravity(0.0, 0.0, 0.0),
        seconds=0.1 if tension > 100.0 else 1.0,
        rest=(0.0, 0.0, 0.0),
        kinetic=tension * (6.0 - (36.0 * math.pi) ** (1.0 / 3.0)) * a**2,
    )


def scaled(edge: float) -> dict[str, Any]:
    """The usual cube with that edge [m]."""
    s = edge / EDGE
    return {
        "box": {"size": [edge] * 3},
        "layers": [{"spacing": s * D}],
        "water": [{"lo": [0, 0, 0], "hi": [edge, s * DEPTH, edge]}],
    }


def relieved(case: Hard) -> Hard:
    """The same with shear relief."""
    terms = {**case.scene.get("projection", {}), "shear_relief": 0.9}
    return replace(case, scene={**case.scene, "projection": terms}, classic=False)


def places(make: Callable[[np.ndarray], np.ndarray]) -> Callable[[Simulation], None]:
    """Puts the particles where make(x) says before the run, and starts it anew."""

    def change(sim: Simulation) -> None:
        sim.initial = {**sim.initial, "x": make(sim.initial["x"].copy()).astype(np.float32)}
        sim.reset()

    return change


def pairs(x: np.ndarray) -> np.ndarray:
    """Every second particle in the place of the one before."""
    x[1::2] = x[0 : 2 * len(x[1::2]) : 2]
    return x


def heap(x: np.ndarray) -> np.ndarray:
    """A thousand in one point."""
    x[:1000] = MIDDLE
    return x


def on_walls(x: np.ndarray) -> np.ndarray:
    """The outermost on walls, edges and corners."""
    low, high = x.min(), x[:, 0].max()
    x[x < low + 1e-4] = 0.0
    for axis in (0, 2):
        x[x[:, axis] > high - 1e-4, axis] = EDGE
    return x


def longer_steps(factor: float) -> Callable[[Simulation], None]:
    """Steps of so many times the bound."""

    def change(sim: Simulation) -> None:
        bound = sim.solver.longest_step
        sim.solver.longest_step = lambda safety=1.0: factor * bound(safety)

    return change


# Ends of runs that cannot go on: more neighbours than there is memory for, water without a way.
COLLAPSED, TRAPPED = "the water blew up: the neighbours of", "obstacles.0 presses water"
PISTON = {"lo": [-0.5, -0.1, -0.1], "hi": [-0.01, 0.7, 0.7]}
HOUR = 3600.0
BALL = {"centre": list(MIDDLE), "radius": 0.1}

CASES: dict[str, Hard] = {
    "still": Hard("rest", classic=True),
    "column, 80 spacings": Hard("rest", column(1), seconds=2.0),
    "column, six layers": Hard("rest", column(6), seconds=2.0),
    "mass ratio 8, fine on coarse": Hard("rest", stacked(8.0, True), classic=True),
    "mass ratio 8, coarse on fine": Hard("rest", stacked(8.0, False), classic=True),
    "mass ratio 64, fine on coarse": Hard("rest", stacked(64.0, True)),
    "mass ratio 64, coarse on fine": Hard("rest", stacked(64.0, False)),
    "pairs in one place": Hard("they part", change=places(pairs), classic=True),
    "a thousand in one point": Hard(
        "is refused in a line", change=places(heap), classic=True, named=COLLAPSED
    ),
    "on walls, edges, corners": Hard("nothing leaves", change=places(on_walls), classic=True),
    "upside down": Hard("falls, nothing leaves", ADAPTIVE, gravity(0.0, 9.81, 0.0)),
    "shaken at 10 g": Hard("nothing leaves", ADAPTIVE, shaken(98.1, 4.0)),
    "hand of 100 m/s, sideways": Hard("nothing leaves", drive=hand((100.0, 0, 0)), seconds=0.5),
    "hand of 100 m/s, down": Hard("nothing leaves", drive=hand((0, -100.0, 0)), seconds=0.5),
    "steps of 2 bounds": Hard("finite", ADAPTIVE, shaken(9.81, 1.0), change=longer_steps(2.0)),
    "steps of 5 bounds": Hard("finite", ADAPTIVE, shaken(9.81, 1.0), change=longer_steps(5.0)),
    "host halts half a second": Hard("goes on", ADAPTIVE, frame=0.5, seconds=1.0),
    "piston, slow": Hard(
        "the trapped water is named",
        body(**PISTON, velocity=[0.3, 0, 0]),
        seconds=4.0,
        named=TRAPPED,
    ),
    "piston, fast": Hard(
        "the trapped water is named",
        body(**PISTON, velocity=[5.0, 0, 0]),
        seconds=1.0,
        named=TRAPPED,
    ),
    "mixer of 20 turns a second": Hard(
        "nothing leaves",
        body(lo=[0.12, 0.08, 0.26], hi=[0.48, 0.2, 0.34], spin=7200.0),
        seconds=0.5,
    ),
    "ball shot through at 50 m/s": Hard(
        "nothing leaves",
        body(centre=[-0.5, 0.14, 0.3], radius=0.1, velocity=[50, 0, 0]),
        seconds=0.1,
    ),
    "sheet of one particle": Hard(
        "rest", {"water": [{"lo": [0, 0, 0], "hi": [EDGE, D, EDGE]}]}, settles=False, classic=True
    ),
    "spray": Hard(
        "falls",
        {"layers": layers(1.0, spacing=0.02)},
        change=places(lambda x: (x - x.min()) / np.ptp(x, axis=0) * 0.55 + 0.02),
        settles=False,
    ),
    "one particle": Hard(
        "falls and rests",
        {"water": [{"lo": [0.28, 0.28, 0.28], "hi": [0.32, 0.32, 0.32]}]},
        settles=False,
        classic=True,
    ),
    "pool of particles full": Hard(
        "splits are refused, and said",
        {**ADAPTIVE, "adaptation": {"enabled": True, "capacity": 820}},
        shaken(9.81, 1.0),
    ),
    "full to the lid": Hard(
        "rest",
        {"box": {"size": [EDGE, DEPTH, EDGE]}},
        shaken(9.81, 1.0),
        settles=False,
    ),
    "domain of 100 m": Hard("rest", scaled(100.0), seconds=2.0),
    "domain of 1 mm": Hard("rest", scaled(1e-3), seconds=0.5),
    **{f"tension {sigma:g} N/m": cube_of(sigma) for sigma in (0.072, 10.0, 1000.0)},
    "viscosity 10 Pa s": Hard(
        "rest", {"projection": {"viscosity": 10.0}}, shaken(9.81, 1.0), classic=False
    ),
    "viscosity 1e5 Pa s": Hard("rest", {"projection": {"viscosity": 1e5}}, shaken(9.81, 1.0)),
    "resampled at every step": Hard(
        "rest",
        {**ADAPTIVE, "adaptation": {"enabled": True, "every": 1, "hysteresis": 0.0, "travel": 0.0}},
        shaken(4.0, 1.0),
    ),
    "gravity sideways": Hard("nothing leaves", ADAPTIVE, gravity(9.81, 0.0, 0.0)),
    "no gravity": Hard(
        "stays", ADAPTIVE, gravity(0.0, 0.0, 0.0), rest=(0.0, 0.0, 0.0), settles=False
    ),
    "gravity of 30 m/s^2": Hard("rest", ADAPTIVE, gravity(0.0, -30.0, 0.0), rest=(0, -30.0, 0)),
    "an hour": Hard(
        "rest, no leaks, no growth",
        {"layers": [{"spacing": 0.1}], "water": [{"lo": [0, 0, 0], "hi": [EDGE, 0.4, EDGE]}]},
        shaken(1.0, 0.1),
        seconds=HOUR,
        settles=False,
    ),
}
CASES |= {
    f"{name}, shear relief": relieved(CASES[name])
    for name in (
        "still",
        "column, 80 spacings",
        "column, six layers",
        "mass ratio 64, fine on coarse",
        "mass ratio 64, coarse on fine",
        "upside down",
        "shaken at 10 g",
        "steps of 5 bounds",
        "ball shot through at 50 m/s",
        "sheet of one particle",
        "spray",
        "an hour",
    )
}


def short(case: Hard) -> Hard:
    """The same, as tests run it."""
    return replace(case, seconds=min(case.seconds, 0.2))
