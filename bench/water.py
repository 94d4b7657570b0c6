"""Water of a benchmark: particles of one program, read and advanced in the same way for all."""

from typing import Protocol

import numpy as np
import taichi as ti

from msph.fluid.external_forces import ExternalForces
from msph.fluid.simulation import Simulation
from msph.measure.snapshot import Snapshot


class Water(Protocol):
    """Particles in a box of `size` [m] at `time` [s]; count: number of particles; steps,
    iterations: totals since the start."""

    size: tuple[float, float, float]

    @property
    def time(self) -> float: ...
    @property
    def count(self) -> int: ...
    @property
    def steps(self) -> int: ...
    @property
    def iterations(self) -> int: ...

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


def water_of(water: "Water | Simulation") -> "Water":
    """Returns the water of a simulation of this program; any other water is returned as it is."""
    return Ours(water) if isinstance(water, Simulation) else water


class Ours:
    """The water of a simulation of this program."""

    def __init__(self, simulation: Simulation):
        self.simulation, self.size = simulation, simulation.size
        self._spacings = np.array([s.spacing for s in simulation.layers.specs])

    time = property(lambda self: self.simulation.time)
    count = property(lambda self: self.simulation.particles.count)
    steps = property(lambda self: self.simulation.steps)
    iterations = property(lambda self: self.simulation.iterations)

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
        particles = self.simulation.particles
        padded = np.zeros((particles.capacity, 3), np.float32)
        padded[: len(v)] = v
        particles.v.from_numpy(padded)

    def snapshot(self) -> Snapshot:
        return Snapshot.of(self.simulation)

    def advance(self, seconds: float, gravity: float) -> None:
        self.simulation.advance(seconds, ExternalForces(gravity=(0.0, -gravity, 0.0)))
        ti.sync()
