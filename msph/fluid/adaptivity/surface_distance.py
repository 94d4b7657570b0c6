"""Depth below the free surface, computed on a grid.

Detectors based on a particle's neighbours find false surfaces between layers of different size. A
grid cell is water if particles cover its centre; voids smaller than 2 x 2 x 2 cells, walls and
bodies count as water. The nearest air cell is exact (Saito and Toriwaki 1994: one pass per axis).
The position of the surface within a cell follows from the coverage: with depths in whole cells,
bands would be off by half a spacing, and water would split and merge whenever the surface crosses a
cell.
"""

import math
from typing import Any

import taichi as ti

from msph.fluid.boundary.body_shapes import BEGIN
from msph.fluid.part import Part, Parts
from msph.fluid.particles import kernels
from msph.fluid.particles.layers import LayerSpec
from msph.launches import data_oriented, kernel

# Coverage sum V_j W (-) above which a cell is water; gaps between mixed sizes stay above it.
COVERED = 0.35
# Support of the covering kernel: REACH own spacings plus MARGIN finest spacings. REACH keeps the
# sum in lattices above 0.5; MARGIN makes coverage fade over a cell.
REACH, MARGIN = 1.6, 0.4
# Distance [cells] from the centre of an air cell to the surface, plus the coverages of that cell
# and of its wettest neighbour. Fitted to pools with levels at cell faces and between.
SURFACE_OFFSET = 1.46
# Edge of a cell, in supports of the finest layer: a band is at least two cells thick.
CELL = 0.6


@data_oriented
class SurfaceDistance(Part):
    """Distance [m] to the free surface, accurate to about a fifth of a cell.

    Larger distances than depth_reach cells are not searched and read as about depth_reach cells.
    """

    def __init__(self, parts: Parts):
        super().__init__(parts)
        room = parts.room
        self.coverage = ti.field(ti.f32, shape=room.depth_cells)
        self.air = ti.field(ti.i32, shape=room.depth_cells)
        # Squared distance [cells^2] to the nearest air cell, and its index; double-buffered.
        self.squares, self.nearest = (
            ti.field(ti.i32, shape=(2, room.depth_cells)) for _ in range(2)
        )
        # gap: distance from the centre of an air cell to the surface; depth. Both in cells.
        self.gap, self.depth = (ti.field(ti.f32, shape=room.depth_cells) for _ in range(2))

    def refresh(self) -> None:
        """Computes the depth of every cell."""
        self._cover(self.particles.count)
        if self.boundary.count:
            self._cover_by_bodies()
        self._find_air()
        for axis in range(3):
            self._spread(axis % 2, (axis + 1) % 2, axis)
        self._measure()

    @ti.func
    def cells(self):
        """Returns the number of cells."""
        dims = self.constants.depth_dims[None]
        return dims[0] * dims[1] * dims[2]

    @ti.func
    def cell_index(self, c, dims):
        """Returns the index of cell c (3,) in a grid of dims (3,)."""
        return (c[0] * dims[1] + c[1]) * dims[2] + c[2]

    @ti.func
    def cell_at(self, cell_index, dims):
        """Returns the cell (3,) of an index."""
        row = cell_index // dims[2]
        return ti.Vector([row // dims[1], row % dims[1], cell_index % dims[2]])

    @ti.func
    def at(self, x):
        """Returns the depth [m] at x [m], interpolated between cells; 0 at the surface."""
        cell, dims = self.constants.depth_cell[None], self.constants.depth_dims[None]
        g = x / cell - 0.5
        base = ti.math.clamp(ti.floor(g, ti.i32), 0, ti.max(dims - 2, 0))
        t = ti.math.clamp(g - ti.cast(base, ti.f32), 0.0, 1.0)
        depth = 0.0
        for corner in ti.static(ti.ndrange(2, 2, 2)):
            at, weight = ti.Vector([0, 0, 0]), 1.0
            for k in ti.static(range(3)):
                at[k] = ti.min(base[k] + corner[k], dims[k] - 1)
                weight *= corner[k] * t[k] + (1 - corner[k]) * (1.0 - t[k])
            depth += weight * self.depth[self.cell_index(at, dims)]
        return ti.max(depth, 0.0) * cell

    @kernel
    def _cover(self, n: ti.i32):
        """Sums the coverage V_j W at the cells' centres, mirror images included."""
        for c in range(self.cells()):
            self.coverage[c] = 0.0
        for i in range(n):
            layer, x = self.particles.layer[i], self.particles.x[i]
            h = REACH * self.layers.spacing[layer] + self.constants.depth_margin[None]
            volume, near = self.layers.volume[layer], self.walls.near(x, h)
            for way in range(self.walls.combinations(near)):
                mirror, wall = self.walls.mirror_and_wall(self.walls.combination(way, near))
                self._cover_by(self.walls.reflected(x, mirror, wall), h, volume)

    @kernel
    def _cover_by_bodies(self):
        """Sets the coverage inside bodies to 1."""
        for c in range(self.cells()):
            at = ti.cast(self.cell_at(c, self.constants.depth_dims[None]), ti.f32)
            centre = (at + 0.5) * self.constants.depth_cell[None]
            if self.boundary.clearance(centre, BEGIN) < 0.0:
                self.coverage[c] = 1.0

    @ti.func
    def _cover_by(self, x, h, volume):
        dims, cell = self.constants.depth_dims[None], self.constants.depth_cell[None]
        lo, hi = first(x[0] - h, cell, dims[0]), last(x[0] + h, cell, dims[0])
        for a in range(lo, hi + 1):
            left = h**2 - ((a + 0.5) * cell - x[0]) ** 2
            half = ti.sqrt(ti.max(left, 0.0))
            lo_b, hi_b = (
                first(x[1] - half, cell, dims[1]),
                last(x[1] + half, cell, dims[1]),
            )
            for b in range(lo_b, hi_b + 1):
                rest = left - ((b + 0.5) * cell - x[1]) ** 2
                deep = ti.sqrt(ti.max(rest, 0.0))
                row = (a * dims[1] + b) * dims[2]
                lo_c, hi_c = (
                    first(x[2] - deep, cell, dims[2]),
                    last(x[2] + deep, cell, dims[2]),
                )
                for c in range(lo_c, hi_c + 1):
                    r2 = h**2 - rest + ((c + 0.5) * cell - x[2]) ** 2
                    self.coverage[row + c] += volume * kernels.quartic(ti.sqrt(r2), h)

    @kernel
    def _find_air(self):
        """Marks the cells of dry blocks of 2 x 2 x 2 as air; smaller voids are water."""
        for c in range(self.cells()):
            self.air[c] = 0
        for k in range(self.cells()):
            dims = self.constants.depth_dims[None]
            c, dry = self.cell_at(k, dims), 1
            for corner in ti.static(ti.ndrange(2, 2, 2)):
                at = self.cell_index(ti.min(c + ti.Vector(corner), dims - 1), dims)
                dry = ti.select(self.coverage[at] < COVERED, dry, 0)
            if dry == 1:
                for corner in ti.static(ti.ndrange(2, 2, 2)):
                    self.air[self.cell_index(ti.min(c + ti.Vector(corner), dims - 1), dims)] = 1
        for c in range(self.cells()):
            reach = self.constants.depth_reach[None]
            self.squares[0, c] = ti.select(self.air[c] == 1, 0, reach * reach)
            self.nearest[0, c] = c
            self.gap[c] = self._gap(c)

    @ti.func
    def _gap(self, cell_index):
        """Returns the distance [cells] from a cell to the surface, towards its wettest
        neighbour."""
        dims, wettest, own = self.constants.depth_dims[None], 0.0, self.coverage[cell_index]
        c = self.cell_at(cell_index, dims)
        for axis in ti.static(range(3)):
            for way in ti.static((-1, 1)):
                beside = ti.math.clamp(c + way * ti.Vector.unit(3, axis, ti.i32), 0, dims - 1)
                at = self.cell_index(beside, dims)
                wettest = ti.max(wettest, ti.select(self.air[at] == 1, 0.0, self.coverage[at]))
        return ti.math.clamp(SURFACE_OFFSET - ti.min(wettest, 1.0) - own, 0.0, 1.0)

    @kernel
    def _spread(self, near: ti.i32, far: ti.i32, axis: ti.i32):
        """squares[far] = min over k of squares[near](cell + k along the axis) + k^2; nearest[far]
        is the air cell with that minimum."""
        for c in range(self.cells()):
            dims = self.constants.depth_dims[None]
            least, best, k = self.squares[near, c], 0, 1
            along = ti.cast(ti.Vector([axis == 0, axis == 1, axis == 2]), ti.i32)
            step = self.cell_index(along, dims)
            place, end = self.cell_at(c, dims).dot(along), dims.dot(along) - 1
            # Search outwards until k^2 alone exceeds the minimum.
            while k * k < least:
                for way in ti.static((-k, k)):
                    if 0 <= place + way <= end:
                        square = self.squares[near, c + way * step] + k * k
                        if square < least:
                            least, best = square, way
                k += 1
            self.squares[far, c] = least
            self.nearest[far, c] = self.nearest[near, c + best * step]

    @kernel
    def _measure(self):
        """Computes the depth of the cells' centres, negative in air."""
        for c in range(self.cells()):
            distance = ti.sqrt(ti.cast(self.squares[1, c], ti.f32))
            self.depth[c] = distance - self.gap[self.nearest[1, c]]


@ti.func
def first(x, cell, count):
    """Returns the first of `count` cells along an axis with its centre at or beyond x [m]."""
    return ti.math.clamp(ti.ceil(x / cell - 0.5, ti.i32), 0, count - 1)


@ti.func
def last(x, cell, count):
    """Returns the last of `count` cells along an axis with its centre at or before x [m]."""
    return ti.math.clamp(ti.floor(x / cell - 0.5, ti.i32), 0, count - 1)


def depth_constants(
    size: tuple[float, float, float], finest: LayerSpec, farthest: float
) -> dict[str, Any]:
    """Returns the constants of the depth grid for a box of `size` [m], up to a depth `farthest`
    [m]."""
    cell = CELL * finest.support
    return {
        "depth_cell": cell,
        "depth_margin": MARGIN * finest.spacing,
        # Whole cells; the last ones include the remainder.
        "depth_dims": tuple(max(1, int(edge / cell)) for edge in size),
        "depth_reach": math.ceil(farthest / cell) + 1,
    }
