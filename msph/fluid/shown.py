"""Water and bodies at the end of a frame, for surface and image.

Steps need not end with frames: particles of a simulation may be up to a step ahead of the frame.
Between forces they move with constant velocities, so that they are moved back along them.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import taichi as ti

from msph.fluid.particles.grid import LayeredGrid
from msph.fluid.particles.particles import Particles
from msph.launches import data_oriented, kernel

if TYPE_CHECKING:
    from msph.fluid.simulation import Simulation
    from msph.fluid.world import World

vec3 = ti.math.vec3


@data_oriented
class Shown:
    """Copies of the particles of a world, `particles`, sorted into their own `grid`."""

    def __init__(self, world: "World"):
        parts = world.parts
        self.source = parts.particles
        self.particles = Particles(parts.room.particles, ())
        self.grid = LayeredGrid(parts.room, parts.constants, parts.layers, self.particles)

    def load(self) -> None:
        """Takes the largest number of particles from the scene that the world has loaded."""
        self.particles.capacity = self.source.capacity

    @contextmanager
    def at_frame(self, sim: "Simulation") -> Iterator[None]:
        """Context in which the particles, in the order of the simulation's, and the bodies are
        where they are at sim.time. Changes nothing in the simulation."""
        n = self.particles.count = self.source.count
        self.grid.invalidate()
        self._copy(n, -sim.ahead, sim.region)
        with sim.boundary.shifted(-sim.ahead):
            yield

    @kernel
    def _copy(self, n: ti.i32, dt: ti.f32, size: vec3):
        """Copies the particles and moves them by dt [s], at most up to the walls of the region."""
        ti.loop_config(serialize=self.traits.light)
        for i in range(n):
            x, v = self.source.x[i], self.source.v[i]
            moved = ti.math.clamp(x + dt * v, ti.min(x, 0.0), ti.max(x, size))
            self.particles.x[i], self.particles.v[i] = moved, v
            self.particles.layer[i], self.particles.id[i] = self.source.layer[i], self.source.id[i]
