"""Per-layer grids: a counting sort bins the particles of each layer into cells of its support h.

One array of cells holds the grids of all layers, one after the other, so a single sort orders the
particles by (layer, cell), and the cells of a z-run are one contiguous range of particles.
"""

import math

import numpy as np
import taichi as ti

from msph.fluid.layers import Layers
from msph.fluid.particles import Particles, one_thread_does
from msph.fluid.scan import ExclusiveScan


def grid_shape(size: tuple[float, float, float], cell: float) -> tuple[int, int, int]:
    """Cells of edge `cell` [m] along each axis that cover a box of the given size [m]."""
    nx, ny, nz = (max(1, math.ceil(length / cell)) for length in size)
    return nx, ny, nz


@ti.data_oriented
class LayeredGrid:
    """Grids over the box (0, 0, 0) to size [m], one per layer, its cell edge that layer's h.

    Fields, for L layers and C cells in all: cell_start (C + 1,) i32, first particle of each cell;
    dims (L,) ivec3; offset (L,) i32, first cell of each layer; cell_size (L,) f32 [m].
    """

    def __init__(self, size: tuple[float, float, float], layers: Layers, particles: Particles):
        self.layers = layers
        self.particles = particles
        shapes = [grid_shape(size, s.support) for s in layers.specs]
        cells = [nx * ny * nz for nx, ny, nz in shapes]
        self.total_cells = sum(cells)
        self.few_cells = one_thread_does(self.total_cells)
        self.dims = ti.Vector.field(3, ti.i32, shape=layers.count)
        self.offset = ti.field(ti.i32, shape=layers.count)
        self.cell_size = layers.support
        self.cell_count = ti.field(ti.i32, shape=self.total_cells)
        self.cell_start = ti.field(ti.i32, shape=self.total_cells + 1)
        self.cell = ti.field(ti.i32, shape=particles.capacity)
        self.place = ti.field(ti.i32, shape=particles.capacity)
        self.scan = ExclusiveScan(self.total_cells)
        self.dims.from_numpy(np.array(shapes, dtype=np.int32))
        self.offset.from_numpy(np.cumsum([0, *cells[:-1]]).astype(np.int32))
        self.generation = 0  # of the order of particles: lists made of an earlier one are void
        self.stale = True

    def invalidate(self) -> None:
        """Tells the grid that particles moved."""
        self.stale = True

    def refresh(self) -> None:
        """Sorts the particles if they moved since the last time."""
        if self.stale:
            self.build()

    def build(self) -> None:
        """Sorts the particles by (layer, cell): count, scan, place, reorder."""
        n, alone = self.particles.count, self.particles.alone
        self._count(n, alone)
        self.scan.run(self.cell_count, self.cell_start)
        self._place(n, alone)
        self.particles.reorder(self.place, n, alone)
        self.generation += 1
        self.stale = False

    @ti.kernel
    def _count(self, n: ti.i32, alone: ti.template()):
        ti.loop_config(serialize=self.few_cells)
        for c in range(self.total_cells):
            self.cell_count[c] = 0
        ti.loop_config(serialize=alone)
        for i in range(n):
            layer = self.particles.layer[i]
            dims = self.dims[layer]
            c = self.cell_of(self.particles.x[i], layer)
            cell = self.offset[layer] + (c[0] * dims[1] + c[1]) * dims[2] + c[2]
            self.cell[i] = cell
            self.place[i] = ti.atomic_add(self.cell_count[cell], 1)

    @ti.kernel
    def _place(self, n: ti.i32, alone: ti.template()):
        ti.loop_config(serialize=alone)
        for i in range(n):
            self.place[i] += self.cell_start[self.cell[i]]

    @ti.func
    def cell_of(self, x, layer):
        """Cell of the point x in a layer's grid; points outside belong to the nearest cell."""
        c = ti.floor(x / self.cell_size[layer], ti.i32)
        return ti.math.clamp(c, 0, self.dims[layer] - 1)

    @ti.func
    def row(self, layer, i, j, k_lo, k_hi):
        """Particles [begin, end) of the cells (i, j, k_lo) to (i, j, k_hi), all inside the grid."""
        dims = self.dims[layer]
        base = self.offset[layer] + (i * dims[1] + j) * dims[2]
        return ti.Vector([self.cell_start[base + k_lo], self.cell_start[base + k_hi + 1]])

    @ti.func
    def slab(self, layer, i, j_lo, j_hi):
        """Particles [begin, end) of all cells (i, j, k) with j_lo <= j <= j_hi and any k."""
        dims = self.dims[layer]
        base = self.offset[layer] + i * dims[1] * dims[2]
        return ti.Vector(
            [
                self.cell_start[base + j_lo * dims[2]],
                self.cell_start[base + (j_hi + 1) * dims[2]],
            ]
        )

    @ti.func
    def for_each_row(self, x, layer, reach, visit: ti.template(), out: ti.template()):
        """Calls visit(begin, end, out) for rows of a layer's particles that hold all of them with
        |x - x_j| < reach [m], and others.

        Rows of cells, and the ends of rows, that the ball around x does not meet are skipped.
        """
        h = self.cell_size[layer]
        lo = self.cell_of(x - reach, layer)
        hi = self.cell_of(x + reach, layer)
        for a in range(lo[0], hi[0] + 1):
            # Cells at the border also hold what lies beyond it, so only inner gaps count.
            gap_a = ti.max(a * h - x[0], x[0] - (a + 1) * h, 0.0)
            # One look at the whole slab of rows: most layers are nowhere near most particles.
            slab = self.slab(layer, a, lo[1], hi[1])
            last = ti.select(slab[1] > slab[0], hi[1], lo[1] - 1)
            for b in range(lo[1], last + 1):
                gap_b = ti.max(b * h - x[1], x[1] - (b + 1) * h, 0.0)
                half2 = reach * reach - gap_a * gap_a - gap_b * gap_b
                if half2 > 0.0:
                    half = ti.sqrt(half2)
                    # Clamped on both sides: a position that is not finite must not index memory.
                    k_lo = ti.math.clamp(ti.floor((x[2] - half) / h, ti.i32), lo[2], hi[2])
                    k_hi = ti.math.clamp(ti.floor((x[2] + half) / h, ti.i32), lo[2], hi[2])
                    row = self.row(layer, a, b, k_lo, k_hi)
                    visit(row[0], row[1], out)
