"""The neighbour list: who is within reach of whom, over all layers, as one compact array.

Lists are found with a margin (Verlet 1967) and kept while no particle has moved half of it, so
that the many short steps of an explicit method share one search.
"""

import math

import taichi as ti

from msph.fluid.grid import BLOCK, LayeredGrid
from msph.fluid.layers import LayerSpec
from msph.fluid.particles import Particles
from msph.fluid.scan import ExclusiveScan

# Room in the list, in neighbours at rest: compressed water and mixed sizes need more than rest.
ROOM = 2.0


class NeighbourOverflowError(RuntimeError):
    """More pairs of neighbours than the list holds: the fluid has collapsed."""


@ti.data_oriented
class NeighbourList:
    """Neighbours of particle i: index[start[i]] to index[start[i + 1] - 2], i itself left out.

    The last slot of each particle is scratch, which lets the search write without branching.

    j is listed while r_ij < h_j + margin (scatter form), or max(h_i, h_j) + margin where
    symmetric. margin is a share (-) of the finest support. start (capacity + 1,) i32, index
    (room,) i32. The kernels vanish at h, so whoever reads the list need not test the distance.
    """

    def __init__(self, grid: LayeredGrid, particles: Particles, symmetric: bool, margin: float):
        self.grid = grid
        self.particles = particles
        self.symmetric = symmetric
        self.margin = margin * grid.layers.finest.support
        self.room = self.room_for(particles.capacity, grid.layers.specs, margin)
        self.count = ti.field(ti.i32, shape=particles.capacity)
        self.start = ti.field(ti.i32, shape=particles.capacity + 1)
        self.index = ti.field(ti.i32, shape=self.room)
        self.scan = ExclusiveScan(particles.capacity)
        self.slack = 0.0

    @staticmethod
    def room_for(capacity: int, specs: list[LayerSpec], margin: float) -> int:
        """Entries of the list for a pool of `capacity` particles."""
        widest = max(s.smoothing for s in specs) * (1.0 + margin)
        ratio = max(s.mass for s in specs) / min(s.mass for s in specs)
        at_rest = 4.0 / 3.0 * math.pi * widest**3
        return int(capacity * at_rest * ROOM * (1.0 + math.log2(ratio) / 4.0))

    def find(self) -> None:
        """Searches anew; the grid must be fresh. Raises NeighbourOverflowError if full."""
        n = self.particles.count
        self._count(n)
        self.scan.run(self.count, self.start)
        wanted = self.start[self.particles.capacity]
        if wanted > self.room:
            raise NeighbourOverflowError(
                f"{wanted} pairs of neighbours do not fit in a list of {self.room}: "
                f"{wanted / n:.0f} neighbours per particle, the water has collapsed"
            )
        self._fill(n)
        self.slack = self.margin

    def moved(self, distance: float) -> None:
        """Tells the list that no particle has moved farther than `distance` [m] just now."""
        self.slack -= 2.0 * distance

    def invalidate(self) -> None:
        """Tells the list that the particles were reordered."""
        self.slack = 0.0

    @property
    def stale(self) -> bool:
        return self.slack <= 0.0

    @ti.kernel
    def _count(self, n: ti.i32):
        ti.loop_config(block_dim=BLOCK)
        for i in self.count:
            count = 0
            if i < n:
                for layer in range(self.grid.layers.count):
                    reach = self._reach(i, layer)
                    self.grid.for_each_within(
                        self.particles.x[i], layer, reach, self._count_one, count
                    )
            self.count[i] = count

    @ti.kernel
    def _fill(self, n: ti.i32):
        ti.loop_config(block_dim=BLOCK)
        for i in range(n):
            here = ti.Vector([i, self.start[i]])
            for layer in range(self.grid.layers.count):
                reach = self._reach(i, layer)
                self.grid.for_each_within(self.particles.x[i], layer, reach, self._fill_one, here)

    @ti.func
    def _reach(self, i, layer):
        reach = self.grid.cell_size[layer]
        if ti.static(self.symmetric):
            reach = ti.max(reach, self.grid.cell_size[self.particles.layer[i]])
        return reach + self.margin

    @ti.func
    def _count_one(self, j, inside, count: ti.template()):
        count += inside

    @ti.func
    def _fill_one(self, j, inside, here: ti.template()):
        self.index[here[1]] = j
        here[1] += ti.select(j != here[0], inside, 0)
