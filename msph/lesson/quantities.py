"""Numbers of a water by name: from its ledger, its survey, its view. What nobody asks for is not
measured."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from msph.measure.probes import build_probes
from msph.measure.snapshot import Snapshot
from msph.stage.show import Show

# Simulated time [s] between two readings of what takes milliseconds to measure.
SURVEY_EVERY = 0.1


@dataclass(frozen=True)
class Quantity:
    """unit, text: what it is. read: its value. dear: whether to read it takes milliseconds."""

    unit: str
    text: str
    read: Callable[[Show], float]
    dear: bool = False


def _last(name: str) -> Callable[[Show], float]:
    """A number of the ledger's last entry."""
    return lambda show: getattr(show.ledger.entries[-1], name)


def _of_ledger(name: str) -> Callable[[Show], float]:
    """A share that the ledger makes up of its entries [%]."""
    return lambda show: 100.0 * getattr(show.ledger, name)()


def _speed(show: Show) -> float:
    entry = show.ledger.entries[-1]
    return math.sqrt(2.0 * max(entry.kinetic, 0.0) / entry.mass)


def _density_error(show: Show) -> float:
    """Of the positions as they are: those of the last frame."""
    sim = show.simulation
    sim.measure_density()
    density = sim.particles.numpy("density").astype(float)
    return 100.0 * float(np.maximum(density / show.scene.density - 1.0, 0.0).mean())


def _bulk_density(show: Show) -> float:
    from msph.measure.bulk import bulk_density

    water = Snapshot.of(show.simulation)
    return 100.0 * (bulk_density(water.x, water.spacing, water.size, water.free).mean - 1.0)


def _updates(show: Show) -> float:
    sim = show.simulation
    return sum(sim.counts()) / sim.last_step


def _frame_time(show: Show) -> float:
    """Median of the last frames."""
    fluid = [f["fluid"] for f in show.timings.frames if "fluid" in f] if show.timings else []
    return 1e3 * float(np.median(fluid)) if fluid else math.nan


def _exchanges(show: Show) -> float:
    adaptation = getattr(show.simulation.solver, "adaptation", None)
    return float(sum(adaptation.totals)) if adaptation else 0.0


def _mass_error(show: Show) -> float:
    entries = show.ledger.entries
    return 100.0 * (entries[-1].mass / entries[0].mass - 1.0)


def _tilt(show: Show) -> float:
    return math.degrees(math.acos(float(np.clip(show.tilt[1, 1], -1.0, 1.0))))


def _cosines(show: Show) -> tuple[float, float]:
    """Of the view's angle to the vertical in air, and of the bent one in level water (Snell)."""
    c = math.sin(show.camera.elevation)
    n = show.scene.picture.refractive_index
    return c, math.sqrt(1.0 - (1.0 - c * c) / n**2)


def _reflectance(show: Show) -> float:
    """Fresnel's, unpolarised, of level water as the camera looks down on it."""
    c, t = _cosines(show)
    n = show.scene.picture.refractive_index
    rs, rp = (c - n * t) / (c + n * t), (n * c - t) / (n * c + t)
    return 50.0 * show.scene.picture.reflection * (rs * rs + rp * rp)


def _apparent_depth(show: Show) -> float:
    """Where the bent ray seems to end over where it does: tan beyond over tan before."""
    c, t = _cosines(show)
    bent, straight = math.sqrt(1.0 - t * t) / t, math.sqrt(1.0 - c * c) / c
    index = show.scene.picture.refractive_index
    return 100.0 * (bent / straight if straight > 1e-6 else 1.0 / index)


def _red_left(show: Show) -> float:
    """Beer and Lambert: of red light down to the floor, straight through the mean depth."""
    look, size = show.scene.picture, show.simulation.size
    depth = show.rest_volume() / (size[0] * size[2])
    return 100.0 * math.exp(-look.absorption[0] * look.tint * depth)


def _caustics(show: Show) -> float:
    """Standard deviation of the light on the floor over its mean, inside the shores."""
    focus = show.picture.sunlight.focus.to_numpy()
    edge = len(focus) // 4
    inner = focus[edge:-edge, edge:-edge]
    mean = float(inner.mean())
    spread = 100.0 * float(inner.std()) / mean if mean > 0.0 else 0.0
    return spread * show.scene.picture.caustic_contrast


QUANTITIES: dict[str, Quantity] = {
    "time": Quantity("s", "simulated time", lambda show: show.simulation.time),
    "particles": Quantity(
        "-", "number of particles", lambda show: float(sum(show.simulation.counts()))
    ),
    "kinetic": Quantity("J", "kinetic energy", _last("kinetic")),
    "energy_gain": Quantity(
        "%",
        "largest rise of the energy, over M g H and the first kinetic energy",
        _of_ledger("energy_gain"),
        dear=True,
    ),
    "momentum_drift": Quantity(
        "%",
        "change of momentum that no force explains, over the largest sum of mass times speed",
        _of_ledger("momentum_drift"),
        dear=True,
    ),
    "speed": Quantity("m/s", "root mean square of the speed", _speed),
    "top_speed": Quantity("m/s", "speed of the fastest particle", _last("top_speed")),
    "centre_x": Quantity("m", "centre of mass, along x", lambda s: s.ledger.entries[-1].centre[0]),
    "centre_y": Quantity("m", "centre of mass, height", lambda s: s.ledger.entries[-1].centre[1]),
    "mass_error": Quantity("%", "change of the mass, over the mass at the start", _mass_error),
    "merge_loss": Quantity("J", "kinetic energy lost by merges", _last("merge_loss")),
    "exchanges": Quantity("-", "splits and merges since the start", _exchanges),
    "density_error": Quantity(
        "%", "excess of density over rest density, mean of particles", _density_error, dear=True
    ),
    "bulk_density": Quantity(
        "%",
        "difference of bulk density from rest density, over it, from positions",
        _bulk_density,
        dear=True,
    ),
    "volume_error": Quantity(
        "%", "error of the surface's volume", lambda s: 100.0 * s.volume_error(), dear=True
    ),
    "updates": Quantity("1/s", "number of particles over the last time step", _updates),
    "frame_time": Quantity("ms", "wall-clock time of a frame's water", _frame_time),
    "tilt": Quantity("deg", "tilt of the pool", _tilt),
    "reflectance": Quantity(
        "%", "reflectance of level water at the angle of the view", _reflectance
    ),
    "apparent_depth": Quantity(
        "%", "apparent depth of the floor, over the true depth", _apparent_depth
    ),
    "red_left": Quantity("%", "share of red light that reaches the floor", _red_left),
    "caustics": Quantity(
        "%", "standard deviation of the light on the floor, over its mean", _caustics
    ),
}


class Numbers:
    """Quantities and probes of one water as attributes. Dear ones are read again when simulated
    time has gone on by SURVEY_EVERY."""

    def __init__(self, show: Show):
        self._show = show
        self._read: dict[str, tuple[float, float]] = {}  # when [s], and value
        self._probes = {p.name: p for p in build_probes(show.scene) if len(p.heads) == 1}

    def __getattr__(self, name: str) -> float:
        if name in self._probes:
            return self._now(name, lambda _: self._probe(name))
        quantity = QUANTITIES.get(name)
        if quantity is None:
            raise AttributeError(name)
        if not self._show.ledger.entries:
            self._show.ledger.record(self._show.gravity())
        return self._now(name, quantity.read) if quantity.dear else quantity.read(self._show)

    def _probe(self, name: str) -> float:
        return self._probes[name].read(Snapshot.of(self._show.simulation))[0]

    def _now(self, name: str, read: Callable[[Show], float]) -> float:
        time = self._show.simulation.time
        known = self._read.get(name)
        if known is None or not 0.0 <= time - known[0] < SURVEY_EVERY:
            known = self._read[name] = time, read(self._show)
        return known[1]


def known_numbers(scene: Any) -> set[str]:
    """Names of a scene's quantities and probes."""
    return set(QUANTITIES) | {p.name for p in build_probes(scene) if len(p.heads) == 1}
