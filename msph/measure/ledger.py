"""The ledger: mass, momenta, energy and density error of the water, entry by entry."""

import math
from dataclasses import dataclass, field

import numpy as np

from msph.errors import BlowUpError
from msph.fluid.simulation import Simulation
from msph.measure.entry import Entry
from msph.measure.totals import Totals


class NotFiniteError(BlowUpError):
    """The water's state holds NaN or infinity."""


@dataclass
class Ledger:
    """Entries of one run; record() adds one per frame.

    density_every: simulated time [s] between entries that measure density errors, which costs a
    list of neighbours and a sum over it; infinite: none does. The others' are NaN.
    """

    simulation: Simulation
    density_every: float = 0.0
    entries: list[Entry] = field(default_factory=list)
    _tilt_work: float = 0.0
    _gravity: np.ndarray | None = None
    _density_due: float = 0.0

    def __post_init__(self):
        self._totals = self.simulation.world.once(Totals)

    def clear(self) -> None:
        self.entries.clear()
        self._tilt_work, self._gravity = 0.0, None
        self._density_due = 0.0

    def record(self, gravity: tuple[float, float, float]) -> Entry:
        """Reads the water under `gravity` [m/s^2] (box frame). Raises NotFiniteError."""
        sim, g = self.simulation, np.array(gravity)
        totals = self._totals.read()
        if totals["not_finite"] > 0:
            state = np.hstack([sim.particles.numpy("x"), sim.particles.numpy("v")])
            first = int(np.argmin(np.isfinite(state).all(axis=1)))
            raise NotFiniteError(
                f"{totals['not_finite']:.0f} of {sim.particles.count} particles are not finite "
                f"at t = {sim.time:.3f} s (step {sim.steps}), the first: "
                f"{sim.particles.describe(first)}"
            )
        broken = [k for k, value in totals.items() if not np.all(np.isfinite(value))]
        if broken:
            what = ", ".join(broken)
            raise NotFiniteError(f"{what} overflowed at t = {sim.time:.3f} s (step {sim.steps})")
        moment = totals.pop("moment")
        if self._gravity is not None:
            # Turning gravity in the box's frame lifts the water: energy given from outside.
            self._tilt_work -= float(moment @ (g - self._gravity))
        self._gravity = g
        del totals["not_finite"]
        excess = self._density_excess()
        entry = Entry(
            time=sim.time,
            centre=moment / totals["mass"],
            potential=-float(moment @ g),
            gravity=g,
            tilt_work=self._tilt_work,
            density_error_mean=float(excess.mean()),
            density_error_p99=float(np.percentile(excess, 99.0)),
            density_error_max=float(excess.max()),
            outside=int(totals.pop("outside")),
            **totals,
        )
        self.entries.append(entry)
        return entry

    def _density_excess(self) -> np.ndarray:
        """rho/rho0 - 1 where positive, else 0, of each particle where it is now, (n,); one NaN
        where it is not measured."""
        if self.simulation.time < self._density_due or math.isinf(self.density_every):
            return np.array([np.nan])
        # Times are sums of frames.
        self._density_due = self.simulation.time + self.density_every * (1.0 - 1e-6)
        self.simulation.measure_density()
        rest = self.simulation.layers.rest_density
        density = self.simulation.particles.numpy("density").astype(float)
        return np.maximum(density / rest - 1.0, 0.0)

    def momentum_drift(self) -> float:
        """|sum of internal impulses| over the largest sum m |v| of the run (-)."""
        scale = max(e.momentum_scale for e in self.entries)
        drift = max(float(np.linalg.norm(e.internal_impulse)) for e in self.entries)
        return drift / scale if scale > 0.0 else 0.0

    def angular_drift(self) -> float:
        """|sum of internal angular impulses| over the largest angular scale of the run (-)."""
        scale = max(e.angular_scale for e in self.entries)
        drift = max(float(np.linalg.norm(e.internal_angular_impulse)) for e in self.entries)
        return drift / scale if scale > 0.0 else 0.0

    def reference_energy(self) -> float:
        """What energy errors are shares of [J]: the first entry's kinetic energy and M g H, H the
        height of its centre of mass over the lowest corner of the box."""
        first = self.entries[0]
        fall = self.simulation.size * (first.gravity > 0.0) - first.centre
        return first.kinetic + first.mass * float(first.gravity @ fall)

    def energy_gain(self) -> float:
        """Largest rise of the energy over an earlier entry, as a share of reference_energy() (-).

        A dissipative method on its own can only lose, so any gain is error.
        """
        energies = np.array([e.energy for e in self.entries])
        rise = float(np.max(energies - np.minimum.accumulate(energies)))
        first = self.reference_energy()
        return rise / first if first > 0.0 else 0.0

    def energy_rise(self, window: float = 1.0) -> float:
        """Largest rise of kinetic + potential energy between two entries at most `window` [s]
        apart, with no input between them, as a share of reference_energy() (-).

        Input is what moves walls, the user's hand or the pool. NaN where input never ceased.
        """
        rises = [
            later.kinetic + later.potential - earlier.kinetic - earlier.potential
            for earlier, later in self._undisturbed(window)
        ]
        first = self.reference_energy()
        return max(0.0, *rises) / first if rises and first > 0.0 else float("nan")

    def _undisturbed(self, window: float) -> list[tuple[Entry, Entry]]:
        """Pairs of entries at most `window` [s] apart between which nobody gave energy."""
        pairs: list[tuple[Entry, Entry]] = []
        begin = 0  # of the entries that end here and lie within window and stretch
        for k, entry in enumerate(self.entries):
            if k and _disturbed(self.entries[k - 1], entry):
                begin = k
            while entry.time - self.entries[begin].time > window * (1.0 + 1e-6):
                begin += 1
            pairs += [(earlier, entry) for earlier in self.entries[begin:k]]
        return pairs

    def density_error(self) -> tuple[float, float, float]:
        """Means over the run of the mean density error and of its 99th percentile, and the largest
        error of all (-); of the entries that measured them."""
        columns = ("density_error_mean", "density_error_p99", "density_error_max")
        mean, p99, largest = ([getattr(e, k) for e in self.entries] for k in columns)
        if np.isnan(mean).all():
            return np.nan, np.nan, np.nan
        return float(np.nanmean(mean)), float(np.nanmean(p99)), float(np.nanmax(largest))

    def last_density_error(self) -> float:
        """The mean density error that was measured last (-), NaN where none was."""
        found = (e.density_error_mean for e in reversed(self.entries))
        return next((error for error in found if not math.isnan(error)), math.nan)

    def rest_energy(self, seconds: float = 1.0) -> float:
        """Mean kinetic energy [J] over the last `seconds`: zero for water at rest."""
        last = self.entries[-1].time
        return float(np.mean([e.kinetic for e in self.entries if e.time >= last - seconds]))


def _disturbed(before: Entry, after: Entry) -> bool:
    """Whether walls, the user or tilting gave anything between two entries."""
    turned = not np.array_equal(before.gravity, after.gravity)
    pushed = not np.array_equal(before.user_impulse, after.user_impulse)
    return turned or pushed or before.wall_work != after.wall_work
