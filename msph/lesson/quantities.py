"""Quantities of a simulation by name, each measured only when a lesson reads it."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from msph.stage.show import Show


@dataclass(frozen=True)
class Quantity:
    """A quantity: unit, description, function that measures it; slow: True if that takes
    milliseconds; shown: True if it is read from the surface, image or camera."""

    unit: str
    text: str
    read: Callable[[Show], float]
    slow: bool = False
    shown: bool = False


def _last(name: str) -> Callable[[Show], float]:
    """Returns a function that reads an attribute of the ledger's last entry."""
    return lambda show: getattr(show.ledger.entries[-1], name)


def _of_ledger(name: str) -> Callable[[Show], float]:
    """Returns a function that calls a method of the ledger, in percent."""
    return lambda show: 100.0 * getattr(show.ledger, name)()


QUANTITIES: dict[str, Quantity] = {
    "time": Quantity("s", "simulated time", lambda show: show.simulation.time),
    "particles": Quantity(
        "-", "number of particles", lambda show: float(sum(show.simulation.counts()))
    ),
    "kinetic_energy": Quantity("J", "kinetic energy", _last("kinetic")),
    "energy_gain": Quantity(
        "%",
        "largest rise of the energy, over M g H plus the initial kinetic energy",
        _of_ledger("energy_gain"),
        slow=True,
    ),
    "momentum_drift": Quantity(
        "%",
        "momentum created by pair forces, over the largest sum of mass times speed",
        _of_ledger("momentum_drift"),
        slow=True,
    ),
    "top_speed": Quantity("m/s", "speed of the fastest particle", _last("top_speed")),
    "centre_x": Quantity("m", "x of the centre of mass", lambda s: s.ledger.entries[-1].centre[0]),
    "centre_y": Quantity("m", "y of the centre of mass", lambda s: s.ledger.entries[-1].centre[1]),
    "mass_error": Quantity(
        "%",
        "change of the mass, spilt water included, over the initial mass",
        _of_ledger("mass_change"),
    ),
    "merge_loss": Quantity("J", "kinetic energy lost by merges", _last("merge_loss")),
    "bulk_density": Quantity(
        "%",
        "error of the bulk density, computed from positions",
        lambda s: 100.0 * s.bulk_density_error(),
        slow=True,
    ),
    "volume_error": Quantity(
        "%",
        "error of the surface's volume",
        lambda s: 100.0 * s.volume_error(),
        slow=True,
        shown=True,
    ),
}


def quantity(unit: str, text: str, slow: bool = False, shown: bool = False) -> Callable:
    """Returns a decorator that adds a function to QUANTITIES; see Quantity."""

    def add(read: Callable[[Show], float]) -> Callable[[Show], float]:
        QUANTITIES[read.__name__] = Quantity(unit, text, read, slow, shown)
        return read

    return add


@quantity("m/s", "root mean square of the speed")
def speed(show: Show) -> float:
    entry = show.ledger.entries[-1]
    return math.sqrt(2.0 * max(entry.kinetic, 0.0) / entry.mass)


@quantity("%", "the solver's own density above rest density, mean over particles", slow=True)
def solver_residual(show: Show) -> float:
    sim = show.simulation
    sim.measure_density()
    density = sim.particles.numpy("density").astype(float)
    return 100.0 * float(np.maximum(density / show.scene.density - 1.0, 0.0).mean())


@quantity("1/s", "particle updates per simulated second")
def updates(show: Show) -> float:
    sim = show.simulation
    return sum(sim.counts()) / sim.last_step


@quantity("ms", "elapsed time of the fluid per frame")
def frame_time(show: Show) -> float:
    fluid = [f["fluid"] for f in show.timings.frames if "fluid" in f]
    return 1e3 * float(np.median(fluid)) if fluid else math.nan


@quantity("-", "splits and merges since the start")
def exchanges(show: Show) -> float:
    adaptation = getattr(show.simulation.solver, "adaptation", None)
    return float(sum(adaptation.totals)) if adaptation else 0.0


@quantity("deg", "tilt of the pool")
def tilt(show: Show) -> float:
    return math.degrees(math.acos(float(np.clip(show.pose.tilt[1, 1], -1.0, 1.0))))


def _cosines(show: Show) -> tuple[float, float]:
    """Returns the cosines of the view ray's angles to the vertical: in air, and refracted in level
    water (Snell)."""
    c = math.sin(show.display.camera.elevation)
    n = show.scene.picture.refractive_index
    return c, math.sqrt(1.0 - (1.0 - c * c) / n**2)


@quantity("%", "reflectance of level water at the camera's elevation", shown=True)
def reflectance(show: Show) -> float:
    """By Fresnel's equations, as rendered."""
    c, t = _cosines(show)
    n = show.scene.picture.refractive_index
    rs, rp = (c - n * t) / (c + n * t), (n * c - t) / (n * c + t)
    return 50.0 * show.scene.picture.reflection * (rs * rs + rp * rp)


@quantity("%", "apparent depth of the floor, over the true depth", shown=True)
def apparent_depth(show: Show) -> float:
    """Ratio of the tangents of the refracted and the straight ray."""
    c, t = _cosines(show)
    bent, straight = math.sqrt(1.0 - t * t) / t, math.sqrt(1.0 - c * c) / c
    index = show.scene.picture.refractive_index
    return 100.0 * (bent / straight if straight > 1e-6 else 1.0 / index)


@quantity("%", "share of red light that reaches the floor")
def red_left(show: Show) -> float:
    """By the law of Beer and Lambert, over the mean depth."""
    look, size = show.scene.picture, show.simulation.size
    depth = show.rest_volume() / (size[0] * size[2])
    return 100.0 * math.exp(-look.absorption[0] * look.tint * depth)


@quantity("%", "standard deviation of the light on the floor, over its mean", shown=True)
def caustics(show: Show) -> float:
    """As rendered, away from the walls."""
    focus = show.display.picture.sunlight.focus.to_numpy()
    edge = len(focus) // 4
    inner = focus[edge:-edge, edge:-edge]
    mean = float(inner.mean())
    spread = 100.0 * float(inner.std()) / mean if mean > 0.0 else 0.0
    return spread * show.scene.picture.caustic_contrast
