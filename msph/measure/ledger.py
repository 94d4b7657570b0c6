"""The ledger of a run: mass, momenta, energy and solver residual of the water over time."""

import math
from dataclasses import dataclass, field

import numpy as np

from msph.errors import BlowUpError
from msph.fluid.simulation import Simulation
from msph.measure.entry import Entry
from msph.measure.totals import Totals

# Number of voxels for the energy of level water; boxes without bodies are exact with any number.
VOXELS = 200_000


class NotFiniteError(BlowUpError):
    """The state of the water contains NaN or infinity."""


@dataclass
class Ledger:
    """Entries of one run; record() adds one per frame.

    density_every: simulated time [s] between measurements of solver residuals, each of which builds
    a neighbour list; infinite: none. Entries without a measurement hold NaN.
    """

    simulation: Simulation
    density_every: float = 0.0
    entries: list[Entry] = field(default_factory=list)
    _tilt_work: float = 0.0
    # Gravity and first moment of water and floating bodies at the last entry.
    _gravity: np.ndarray | None = None
    _moment: np.ndarray | None = None
    _density_due: float = 0.0

    def __post_init__(self):
        self._totals = self.simulation.world.build_once(Totals)

    def clear(self) -> None:
        self.entries.clear()
        self._tilt_work, self._gravity = 0.0, None
        self._density_due = 0.0

    def record(self, gravity: tuple[float, float, float]) -> Entry:
        """Adds and returns an entry of the water under `gravity` [m/s^2], in the box's frame.

        Raises NotFiniteError if a particle or a total is not finite."""
        sim, g = self.simulation, np.array(gravity)
        sim.contact.push_bodies()
        floating = sim.boundary.floating
        totals = self._totals.read()
        if totals["not_finite"] > 0:
            state = np.hstack([sim.particles.numpy("x"), sim.particles.numpy("v")])
            first = int(np.argmin(np.isfinite(state).all(axis=1)))
            raise NotFiniteError(
                f"{totals['not_finite']:.0f} of {sim.particles.count} particles are not finite "
                f"at t = {sim.reached:.3f} s (step {sim.steps}), the first: "
                f"{sim.particles.describe(first)}"
            )
        if not np.isfinite(np.hstack([*totals.values()])).all():
            what = ", ".join(k for k, value in totals.items() if not np.all(np.isfinite(value)))
            raise NotFiniteError(f"{what} overflowed at t = {sim.reached:.3f} s (step {sim.steps})")
        moment, floating_moment = totals.pop("moment"), floating.mass @ floating.x
        if self._gravity is not None:
            # A turn of the box changes gravity in the box frame, and thus the potential energy, at
            # the beginning of the time since the last entry.
            self._tilt_work -= float(self._moment @ (g - self._gravity))
        self._gravity, self._moment = g, moment + floating_moment
        del totals["not_finite"]
        mean, p99, largest = self._residuals()
        entry = Entry(
            time=sim.reached,
            centre=moment / totals["mass"],
            potential=-float(moment @ g),
            gravity=g,
            body_impulse=-sim.boundary.total_impulse,
            floating_momentum=floating.momentum(),
            floating_angular_momentum=floating.angular_momentum(),
            floating_kinetic=floating.kinetic(),
            floating_potential=-float(floating_moment @ g),
            tilt_work=self._tilt_work,
            inertia_work=totals.pop("inertia_work") + floating.inertia_work,
            solver_residual_mean=mean,
            solver_residual_p99=p99,
            solver_residual_max=largest,
            outside=int(totals.pop("outside")),
            spilt=sim.rim.mass,
            outflow_mass=sim.rim.outflow,
            **totals,
        )
        self.entries.append(entry)
        return entry

    def _residuals(self) -> list[float]:
        """Returns mean, 99th percentile and maximum of max(rho/rho0 - 1, 0) at the current
        positions; NaN if not measured. Particles in inflows are left out: the solves cannot move
        them."""
        if self.simulation.time < self._density_due or math.isinf(self.density_every):
            return [math.nan] * 3
        # The factor allows for rounding, as times are sums of frame times.
        self._density_due = self.simulation.time + self.density_every * (1.0 - 1e-6)
        sim = self.simulation
        sim.measure_density()
        density = sim.particles.numpy("density").astype(float)
        if sim.openings.inlets:
            sim.openings.mark()
            density = density[sim.particles.numpy("prescribed") == 0]
        excess = np.maximum(density / sim.layers.rest_density - 1.0, 0.0)
        return [float(excess.mean()), float(np.percentile(excess, 99.0)), float(excess.max())]

    def mass_change(self) -> float:
        """Returns the relative change of mass (-), apart from the water that left and the water
        that the user or inflows added."""
        first, last = (
            e.mass + e.spilt + e.outflow_mass - e.added_mass - e.inflow_mass
            for e in (self.entries[0], self.entries[-1])
        )
        return (last - first) / (self.entries[0].mass + self.entries[0].spilt)

    def momentum_drift(self) -> float:
        """Returns |sum of internal impulses| over the largest sum m |v| of the run (-)."""
        return self._drift("internal_impulse", "momentum_scale")

    def angular_drift(self) -> float:
        """Returns |sum of internal angular impulses| over the run's largest angular scale (-)."""
        return self._drift("internal_angular_impulse", "angular_scale")

    def _drift(self, impulse: str, reference: str) -> float:
        scale = max(getattr(e, reference) for e in self.entries)
        drift = max(float(np.linalg.norm(getattr(e, impulse))) for e in self.entries)
        return drift / scale if scale > 0.0 else 0.0

    def reference_energy(self) -> float:
        """Returns the reference [J] of energy errors: kinetic energy + M g H of the first entry,
        with H the height of the centre of mass over the lowest corner of the box."""
        first = self.entries[0]
        fall = self.simulation.size * (first.gravity > 0.0) - first.centre
        return first.kinetic + first.mass * float(first.gravity @ fall)

    def motion_energy(self) -> float:
        """Returns the energy of the motion [J], a stricter reference: kinetic plus available
        potential energy (above level water) of the first entry, or the largest kinetic energy of
        the run if that is larger."""
        first = self.entries[0]
        available = 0.0
        if np.any(first.gravity):
            available = first.potential - level_potential(
                self.simulation, first.gravity, first.mass
            )
        kinetic = max(e.kinetic for e in self.entries)
        return max(first.kinetic + available, kinetic) if math.isfinite(available) else kinetic

    def energy_gain(self, reference: float | None = None) -> float:
        """Returns the largest rise of the energy over an earlier entry, over a reference [J], by
        default reference_energy() (-); any rise is an error, as a dissipative method only loses
        energy."""
        energies = np.array([e.energy for e in self.entries])
        rise = float(np.max(energies - np.minimum.accumulate(energies)))
        first = self.reference_energy() if reference is None else reference
        return rise / first if first > 0.0 else 0.0

    def energy_rise(self, window: float = 1.0) -> float:
        """Returns the largest rise of kinetic and potential energy between two entries at most
        `window` [s] apart without input between them, over reference_energy() (-).

        Input is work of walls or inflows, an impulse by the user, or motion of the box. NaN if
        there is always input.
        """
        rises = [
            later.mechanical - earlier.mechanical for earlier, later in self._undisturbed(window)
        ]
        first = self.reference_energy()
        return max(0.0, *rises) / first if rises and first > 0.0 else float("nan")

    def _undisturbed(self, window: float) -> list[tuple[Entry, Entry]]:
        """Returns the pairs of entries at most `window` [s] apart without input between them."""
        pairs: list[tuple[Entry, Entry]] = []
        begin = 0  # first entry that pairs with entry k
        for k, entry in enumerate(self.entries):
            if k and _disturbed(self.entries[k - 1], entry):
                begin = k
            while entry.time - self.entries[begin].time > window * (1.0 + 1e-6):
                begin += 1
            pairs += [(earlier, entry) for earlier in self.entries[begin:k]]
        return pairs

    def solver_residual(self) -> tuple[float, float, float]:
        """Returns the solver residuals of the run (-): means over time of the mean and of the 99th
        percentile, and the largest; NaN if they were not measured."""
        columns = ("solver_residual_mean", "solver_residual_p99", "solver_residual_max")
        mean, p99, largest = ([getattr(e, k) for e in self.entries] for k in columns)
        if np.isnan(mean).all():
            return np.nan, np.nan, np.nan
        return float(np.nanmean(mean)), float(np.nanmean(p99)), float(np.nanmax(largest))

    def rest_energy(self, seconds: float = 1.0) -> float:
        """Returns the mean kinetic energy [J] over the last `seconds`; zero for water at rest."""
        last = self.entries[-1].time
        return float(np.mean([e.kinetic for e in self.entries if e.time >= last - seconds]))


def _disturbed(before: Entry, after: Entry) -> bool:
    """Returns True if there was input by walls, the user, the box or inflows between entries."""
    given = ("gravity", "user_impulse", "inertia_impulse", "wall_work", "inflow_work")
    return not all(np.array_equal(getattr(before, k), getattr(after, k)) for k in given)


def level_potential(simulation: Simulation, gravity: np.ndarray, mass: float) -> float:
    """Returns the least potential energy [J] of `mass` [kg] of water at rest density under gravity
    (3,) [m/s^2], zero at the origin: level water fills the space outside bodies from the lowest
    point, and all parts of this space count as connected. NaN if the space is too small."""
    size = np.array(simulation.region)
    edge = (size.prod() / VOXELS) ** (1.0 / 3.0)
    shape = np.maximum(np.round(size / edge), 1).astype(int)
    cell = size / shape
    centres = (np.indices(shape).reshape(3, -1).T + 0.5) * cell
    centres = centres[simulation.boundary.free(centres, 0.0)]
    # Potential energy per mass [J/kg] of the water's level, over the volume below it.
    levels, counts = np.unique((-centres @ gravity).round(9), return_counts=True)
    below = (np.cumsum(counts) - 0.5 * counts) * cell.prod()
    density = simulation.layers.finest.density
    volume = mass / density
    if len(levels) < 2 or volume > counts.sum() * cell.prod():
        return float("nan")
    slope = (levels[1] - levels[0]) / (below[1] - below[0])
    below, levels = np.append(0.0, below), np.append(levels[0] - slope * below[0], levels)
    inside = below < volume
    x = np.append(below[inside], volume)
    return float(
        density * np.trapezoid(np.append(levels[inside], np.interp(volume, below, levels)), x)
    )
