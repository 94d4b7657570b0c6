"""Water of a benchmark: particles of one program, read and advanced in the same way for all."""

from collections.abc import Callable
from typing import Protocol

import numpy as np
import taichi as ti

from msph.fluid.external_forces import ExternalForces
from msph.fluid.simulation import Simulation
from msph.measure.bulk import bulk_density
from msph.measure.kernel_density import KernelDensity, kernel_density
from msph.measure.snapshot import Snapshot

GRAVITY = 9.81


class Water(Protocol):
    """Particles in a box of `size` [m] at `time` [s]; count: number of particles; steps,
    iterations: totals since the start; free(x, margin): whether points are outside bodies."""

    size: tuple[float, float, float]
    time: float
    count: int
    steps: int
    iterations: int
    free: Callable[[np.ndarray, float], np.ndarray] | None = None

    def positions(self) -> np.ndarray:
        """Returns the positions of the particles, (n, 3) [m]."""

    def velocities(self) -> np.ndarray:
        """Returns the velocities of the particles, (n, 3) [m/s]."""

    def spacings(self) -> np.ndarray:
        """Returns the spacings of the particles, (n,) [m]."""

    def residuals(self) -> np.ndarray:
        """Returns the solver residuals, (n,) (-): the solver's own density over rest - 1, >= 0."""

    def pressures(self) -> np.ndarray | None:
        """Returns the pressures, (n,) [Pa], None if the program has none to compare."""

    def set_velocities(self, v: np.ndarray) -> None:
        """Sets the velocities to v (n, 3) [m/s]."""

    def snapshot(self) -> Snapshot:
        """Returns the state for probes."""

    def advance(self, seconds: float, gravity: float) -> None:
        """Advances by `seconds` [s] under gravity [m/s^2] downwards, until all work is done."""

    def masses(self) -> np.ndarray:
        """Returns the masses of the particles, (n,) [kg]."""
        return 1000.0 * self.spacings() ** 3

    def kernel_density(self) -> KernelDensity:
        """Returns the kernel density error (-)."""
        return kernel_density(self.positions(), self.spacings(), self.size)

    def bulk_density(self) -> float:
        """Returns the mean bulk density over the rest density (-)."""
        return bulk_density(self.positions(), self.spacings(), self.size, self.free).mean

    def centre(self) -> np.ndarray:
        """Returns the centre of mass, (3,) [m]."""
        m = self.masses()
        return (m[:, None] * self.positions()).sum(axis=0) / m.sum()

    def energy(self, gravity: float = GRAVITY) -> float:
        """Returns the kinetic plus potential energy [J]."""
        x, v = self.positions(), self.velocities()
        return float((self.masses() * (0.5 * (v**2).sum(axis=1) + gravity * x[:, 1])).sum())

    def momenta(self, middle: np.ndarray | float) -> tuple[np.ndarray, np.ndarray, float, float]:
        """Returns momentum, angular momentum about `middle` [m], and the sums of m |v| and
        m r |v|."""
        m, arm, v = self.masses()[:, None], self.positions() - middle, self.velocities()
        speed = np.linalg.norm(v, axis=1)
        scale = float((m[:, 0] * speed).sum())
        spin = float((m[:, 0] * np.linalg.norm(arm, axis=1) * speed).sum())
        return (m * v).sum(axis=0), (m * np.cross(arm, v)).sum(axis=0), scale, spin


def water_of(water: "Water | Simulation") -> "Water":
    """Returns the water of a simulation of this program; any other water is returned as it is."""
    return Ours(water) if isinstance(water, Simulation) else water


class Ours(Water):
    """The water of a simulation of this program."""

    def __init__(self, simulation: Simulation):
        self.simulation, self.size = simulation, simulation.size
        self._spacings = np.array([s.spacing for s in simulation.layers.specs])

    time = property(lambda self: self.simulation.time)
    count = property(lambda self: self.simulation.particles.count)
    steps = property(lambda self: self.simulation.steps)
    iterations = property(lambda self: self.simulation.iterations)
    free = property(lambda self: self.simulation.boundary.free)

    def positions(self) -> np.ndarray:
        return self.simulation.particles.numpy("x").astype(float)

    def velocities(self) -> np.ndarray:
        return self.simulation.particles.numpy("v").astype(float)

    def spacings(self) -> np.ndarray:
        return self._spacings[self.simulation.particles.numpy("layer")]

    def residuals(self) -> np.ndarray:
        sim = self.simulation
        sim.measure_density()
        density = sim.particles.numpy("density").astype(float)
        return np.maximum(density / sim.layers.rest_density - 1.0, 0.0)

    def pressures(self) -> np.ndarray:
        return self.simulation.particles.numpy("pressure").astype(float)

    def set_velocities(self, v: np.ndarray) -> None:
        field = self.simulation.particles.v
        field.from_numpy(np.pad(v.astype(np.float32), ((0, field.shape[0] - len(v)), (0, 0))))

    def snapshot(self) -> Snapshot:
        return Snapshot.of(self.simulation)

    def advance(self, seconds: float, gravity: float) -> None:
        self.simulation.advance(seconds, ExternalForces(gravity=(0.0, -gravity, 0.0)))
        ti.sync()
