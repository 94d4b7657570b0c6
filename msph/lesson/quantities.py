"""Quantities of a simulation by name, each measured only when a lesson reads it."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from msph.lesson import physics
from msph.measure.probes import build_probes
from msph.measure.snapshot import Snapshot
from msph.stage.show import Show

# Simulated time [s] between measurements of quantities that take milliseconds.
SURVEY_INTERVAL = 0.1
# Suffix of the names of the amplitudes of probes.
AMPLITUDE = "_amplitude"


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


def _speed(show: Show) -> float:
    entry = show.ledger.entries[-1]
    return math.sqrt(2.0 * max(entry.kinetic, 0.0) / entry.mass)


def _solver_residual(show: Show) -> float:
    """Returns the mean solver residual [%] at the positions of the last frame."""
    sim = show.simulation
    sim.measure_density()
    density = sim.particles.numpy("density").astype(float)
    return 100.0 * float(np.maximum(density / show.scene.density - 1.0, 0.0).mean())


def _updates(show: Show) -> float:
    sim = show.simulation
    return sum(sim.counts()) / sim.last_step


def _frame_time(show: Show) -> float:
    """Returns the median elapsed time [ms] of the fluid over the last frames."""
    fluid = [f["fluid"] for f in show.timings.frames if "fluid" in f]
    return 1e3 * float(np.median(fluid)) if fluid else math.nan


def _exchanges(show: Show) -> float:
    adaptation = getattr(show.simulation.solver, "adaptation", None)
    return float(sum(adaptation.totals)) if adaptation else 0.0


def _tilt(show: Show) -> float:
    return math.degrees(math.acos(float(np.clip(show.pose.tilt[1, 1], -1.0, 1.0))))


def _cosines(show: Show) -> tuple[float, float]:
    """Returns the cosines of the view ray's angles to the vertical: in air, and refracted in level
    water (Snell)."""
    c = math.sin(show.display.camera.elevation)
    n = show.scene.picture.refractive_index
    return c, math.sqrt(1.0 - (1.0 - c * c) / n**2)


def _reflectance(show: Show) -> float:
    """Returns the Fresnel reflectance [%] of level water at the camera's elevation, as rendered."""
    c, t = _cosines(show)
    n = show.scene.picture.refractive_index
    rs, rp = (c - n * t) / (c + n * t), (n * c - t) / (n * c + t)
    return 50.0 * show.scene.picture.reflection * (rs * rs + rp * rp)


def _apparent_depth(show: Show) -> float:
    """Returns the apparent over the true depth [%]: tan of the refracted over the straight ray."""
    c, t = _cosines(show)
    bent, straight = math.sqrt(1.0 - t * t) / t, math.sqrt(1.0 - c * c) / c
    index = show.scene.picture.refractive_index
    return 100.0 * (bent / straight if straight > 1e-6 else 1.0 / index)


def _red_left(show: Show) -> float:
    """Returns the share [%] of red light that crosses the mean depth vertically (Beer-Lambert)."""
    look, size = show.scene.picture, show.simulation.size
    depth = show.rest_volume() / (size[0] * size[2])
    return 100.0 * math.exp(-look.absorption[0] * look.tint * depth)


def _caustics(show: Show) -> float:
    """Returns the standard deviation of the light on the floor over its mean [%], as rendered, away
    from the walls."""
    focus = show.display.picture.sunlight.focus.to_numpy()
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
    "speed": Quantity("m/s", "root mean square of the speed", _speed),
    "top_speed": Quantity("m/s", "speed of the fastest particle", _last("top_speed")),
    "centre_x": Quantity("m", "x of the centre of mass", lambda s: s.ledger.entries[-1].centre[0]),
    "centre_y": Quantity("m", "y of the centre of mass", lambda s: s.ledger.entries[-1].centre[1]),
    "mass_error": Quantity(
        "%",
        "change of the mass, spilt water included, over the initial mass",
        _of_ledger("mass_change"),
    ),
    "merge_loss": Quantity("J", "kinetic energy lost by merges", _last("merge_loss")),
    "exchanges": Quantity("-", "splits and merges since the start", _exchanges),
    "solver_residual": Quantity(
        "%",
        "the solver's own density above rest density, mean over particles",
        _solver_residual,
        slow=True,
    ),
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
    "submerged": Quantity(
        "%",
        "share of the bodies' volume below the level of the water",
        physics.submerged,
        slow=True,
    ),
    "lift": Quantity(
        "N", "vertical force of the water on all bodies, mean of the last 0.5 s", physics.lift
    ),
    "jet_speed": Quantity(
        "m/s", "speed of the water in outflows, mean of the last 0.5 s", physics.jet_speed
    ),
    "sloshing_period": Quantity(
        "s", "period of the water's momentum along x at this gravity", physics.sloshing_period
    ),
    "swing_growth": Quantity(
        "m",
        "growth per period of the swing of the centre of mass along x, mean of three periods",
        physics.swing_growth,
    ),
    "heave_amplitude": Quantity(
        "m", "amplitude of the floating bodies' rise and fall, over 2 s", physics.heave_amplitude
    ),
    "heave_period": Quantity(
        "s", "period of the floating bodies' rise and fall at this gravity", physics.heave_period
    ),
    "updates": Quantity("1/s", "particle updates per simulated second", _updates),
    "frame_time": Quantity("ms", "elapsed time of the fluid per frame", _frame_time),
    "tilt": Quantity("deg", "tilt of the pool", _tilt),
    "reflectance": Quantity(
        "%", "reflectance of level water at the camera's elevation", _reflectance, shown=True
    ),
    "apparent_depth": Quantity(
        "%", "apparent depth of the floor, over the true depth", _apparent_depth, shown=True
    ),
    "red_left": Quantity("%", "share of red light that reaches the floor", _red_left),
    "caustics": Quantity(
        "%", "standard deviation of the light on the floor, over its mean", _caustics, shown=True
    ),
}


class Numbers:
    """Quantities, probes and amplitudes of probes (gauge_amplitude) of a simulation as attributes;
    slow quantities and probes are measured once per SURVEY_INTERVAL. Those of a simulation in
    another process are of its last frame there, NaN until it has answered."""

    def __init__(self, show: Any):
        if not show.parallel:
            show.simulation.record_forces()  # as `lift` needs in gaps between bodies and walls
        self._show = show
        self._read: dict[str, tuple[float, Any]] = {}  # time of measurement [s], and value
        self._probes = {p.name: p for p in build_probes(show.scene) if len(p.heads) == 1}
        self._past: dict[str, list[tuple[float, float]]] = {name: [] for name in self._probes}

    def __getattr__(self, name: str) -> float:
        quantity, probe = QUANTITIES.get(name), self._probes.get(name)
        base = name.removesuffix(AMPLITUDE)
        has_amplitude = base != name and base in self._probes
        if quantity is None and probe is None and not has_amplitude:
            raise AttributeError(name)
        if self._show.parallel:
            if not (quantity and quantity.shown):
                return self._show.number(name)
        elif not self._show.ledger.entries:
            self._show.ledger.record(self._show.gravity())
        if probe:
            return self._cached(name, lambda _: probe.read(self._water())[0])
        if has_amplitude:
            return self._amplitude(base)
        assert quantity
        return self._cached(name, quantity.read) if quantity.slow else quantity.read(self._show)

    def _amplitude(self, name: str) -> float:
        """Returns the amplitude of a probe's readings since it was first asked for."""
        past, value = self._past[name], getattr(self, name)
        time = self._read[name][0]
        if not past or past[-1][0] != time:
            past.append((time, value))
        return physics.amplitude(*np.array(past).T)

    def _water(self) -> Snapshot:
        """Returns the water that the probes read."""
        return self._cached("", lambda show: show.snapshot([*self._probes.values()]))

    def _cached(self, name: str, read: Callable[[Show], Any]) -> Any:
        time = self._show.now.time
        known = self._read.get(name)
        if known is None or not 0.0 <= time - known[0] < SURVEY_INTERVAL:
            known = self._read[name] = time, read(self._show)
        return known[1]


def known_numbers(scene: Any) -> set[str]:
    """Returns the names of a scene's quantities and of its probes with one reading, and of their
    amplitudes."""
    probes = {p.name for p in build_probes(scene) if len(p.heads) == 1}
    return set(QUANTITIES) | probes | {name + AMPLITUDE for name in probes}
