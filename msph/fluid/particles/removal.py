"""Removal of particles that merged into others or left the box."""

import taichi as ti

from msph.fluid.part import Part, Parts
from msph.fluid.particles.prefix_sum import PrefixSum


class Removal(Part):
    """Removes the particles whose attribute `alive` is 0; the others keep their order."""

    def __init__(self, parts: Parts):
        super().__init__(parts)
        self.new_index = ti.field(ti.i32, shape=parts.room.particles + 1)
        self.scan = PrefixSum()

    def compile(self) -> None:
        """Compiles the kernels by launching them without particles."""
        self.scan.run(self.particles.alive, self.new_index, 0)
        self.particles.compact(self.new_index, self.particles.alive, 0)

    def run(self, n: int) -> None:
        """Removes the dead among n particles. Grid and neighbour list become invalid."""
        p = self.particles
        self.scan.run(p.alive, self.new_index, n)
        p.compact(self.new_index, p.alive, n)
        p.count = self.new_index[n]
