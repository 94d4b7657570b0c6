"""The ledger: mass, momentum, energy and density error of the water, entry by entry."""

from dataclasses import dataclass, field

import numpy as np
import taichi as ti

from msph.fluid.simulation import Simulation

# Entries of the block that the device hands over, in this order.
_BLOCK = (
    *("mass", "momentum_x", "momentum_y", "momentum_z", "speed", "kinetic"),
    *("moment_x", "moment_y", "moment_z", "error_sum", "error_max"),
    *("top_speed", "not_finite", "outside"),
)


class NotFiniteError(RuntimeError):
    """The water's state holds NaN or infinity."""


@dataclass(frozen=True)
class Entry:
    """The water at one time, SI units.

    momentum [kg m/s] (3,); momentum_scale = sum m |v| [kg m/s]; internal_impulse [N s] (3,) is
    what pair forces have given in sum since the start, zero where they are antisymmetric.
    density errors (-): mean and max over particles of rho/rho0 - 1 where positive; below rest
    density lies every free surface. outside counts
    particles beyond the box, the container, or inside an obstacle, by more than Walls.leaked says.
    work [J] is what tilting the pool and the pressure on moving bodies have given
    since the start.
    """

    time: float
    mass: float
    momentum: np.ndarray
    momentum_scale: float
    internal_impulse: np.ndarray
    kinetic: float
    potential: float
    work: float
    centre: np.ndarray
    density_error_mean: float
    density_error_max: float
    top_speed: float
    outside: int

    @property
    def energy(self) -> float:
        """Kinetic and potential energy less the work done from outside [J]."""
        return self.kinetic + self.potential - self.work


@dataclass
class Ledger:
    """Entries of one run; record() adds one per frame."""

    simulation: Simulation
    entries: list[Entry] = field(default_factory=list)
    _work: float = 0.0
    _gravity: np.ndarray | None = None

    def __post_init__(self):
        self._measure = _Measure(self.simulation)

    def clear(self) -> None:
        self.entries.clear()
        self._work, self._gravity = 0.0, None

    def record(self, gravity: tuple[float, float, float]) -> Entry:
        """Reads the water under `gravity` [m/s^2] (box frame). Raises NotFiniteError."""
        sim, g = self.simulation, np.array(gravity)
        block = dict(zip(_BLOCK, self._measure.read(sim.particles.count), strict=True))
        if block["not_finite"] > 0:
            raise NotFiniteError(
                f"{block['not_finite']:.0f} of {sim.particles.count} particles are not finite "
                f"at t = {sim.time:.3f} s (step {sim.steps})"
            )
        moment = np.array([block[f"moment_{k}"] for k in "xyz"])
        if not np.all(np.isfinite(list(block.values()))):
            what = ", ".join(k for k, value in block.items() if not np.isfinite(value))
            raise NotFiniteError(f"{what} overflowed at t = {sim.time:.3f} s (step {sim.steps})")
        if self._gravity is not None:
            # Turning gravity in the box's frame lifts the water: energy given from outside.
            self._work -= float(moment @ (g - self._gravity))
        self._gravity = g
        entry = Entry(
            time=sim.time,
            mass=block["mass"],
            momentum=np.array([block[f"momentum_{k}"] for k in "xyz"]),
            momentum_scale=block["speed"],
            internal_impulse=sim.solver.internal_impulse.to_numpy(),
            kinetic=block["kinetic"],
            potential=-float(moment @ g),
            work=self._work + sim.walls.work_done(),
            centre=moment / block["mass"],
            density_error_mean=block["error_sum"] / sim.particles.count,
            density_error_max=block["error_max"],
            top_speed=block["top_speed"],
            outside=int(block["outside"]),
        )
        self.entries.append(entry)
        return entry

    def momentum_drift(self) -> float:
        """|sum of internal impulses| over the largest sum m |v| of the run (-)."""
        scale = max(e.momentum_scale for e in self.entries)
        drift = max(float(np.linalg.norm(e.internal_impulse)) for e in self.entries)
        return drift / scale if scale > 0.0 else 0.0

    def energy_gain(self) -> float:
        """Largest rise of the energy over an earlier entry, as a share of the first energy (-).

        The first energy is kinetic plus potential above the floor. A dissipative method on its
        own can only lose, so any gain is error.
        """
        energies = np.array([e.energy for e in self.entries])
        rise = float(np.max(energies - np.minimum.accumulate(energies)))
        first = abs(self.entries[0].kinetic) + abs(self.entries[0].potential)
        return rise / first if first > 0.0 else 0.0

    def density_error(self) -> tuple[float, float]:
        """Mean over the run of the mean density error, and the largest of all (-)."""
        means = [e.density_error_mean for e in self.entries]
        return float(np.mean(means)), max(e.density_error_max for e in self.entries)

    def rest_energy(self, seconds: float = 1.0) -> float:
        """Mean kinetic energy [J] over the last `seconds`: zero for water at rest."""
        last = self.entries[-1].time
        return float(np.mean([e.kinetic for e in self.entries if e.time >= last - seconds]))


@ti.data_oriented
class _Measure:
    """One reduction over all particles; a single small block is read by the host."""

    def __init__(self, simulation: Simulation):
        self.walls = simulation.walls
        self.particles = simulation.particles
        self.layers = simulation.layers
        self.rest_density = simulation.solver.terms.density
        # Reductions into separate scalars are thread-local on every backend.
        self.sums = [ti.field(ti.f32, shape=()) for _ in _BLOCK]
        self.block = ti.field(ti.f32, shape=len(_BLOCK))

    def read(self, n: int) -> list[float]:
        self._reduce(n)
        return self.block.to_numpy().astype(float).tolist()

    @ti.kernel
    def _reduce(self, n: ti.i32):
        for k in ti.static(range(len(_BLOCK))):
            self.sums[k][None] = 0.0
        for i in range(n):
            m = self.layers.mass[self.particles.layer[i]]
            x, v = self.particles.x[i], self.particles.v[i]
            error = ti.max(self.particles.density[i] / self.rest_density - 1.0, 0.0)
            speed = v.norm()
            self.sums[0][None] += m
            for k in ti.static(range(3)):
                self.sums[1 + k][None] += m * v[k]
                self.sums[6 + k][None] += m * x[k]
            self.sums[4][None] += m * speed
            self.sums[5][None] += 0.5 * m * speed * speed
            self.sums[9][None] += error
            ti.atomic_max(self.sums[10][None], error)
            ti.atomic_max(self.sums[11][None], speed)
            total = x.sum() + v.sum() + error
            if ti.math.isnan(total) or ti.math.isinf(total):
                self.sums[12][None] += 1.0
            if self.walls.leaked(x):
                self.sums[13][None] += 1.0
        for k in ti.static(range(len(_BLOCK))):
            self.block[k] = self.sums[k][None]
