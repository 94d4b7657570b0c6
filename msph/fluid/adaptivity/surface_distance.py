"""Depth below the free surface, on a grid.

Detectors that use a particle's own neighbours fail where sizes mix: they find surfaces at
interfaces of layers deep inside. So depth is a distance on a grid. A cell is water if its centre is
covered by particles; voids smaller than 2 x 2 x 2 cells, walls and bodies count as water. The
nearest cell of air is found exactly (Saito and Toriwaki 1994: one pass per axis). The place of the
surface within the cell follows from the coverage: depths in whole cells would make bands half a
spacing too thick or thin, and sloshing water would split and merge whenever the surface crosses a
cell.
"""

import math

import taichi as ti

from msph.fluid.boundary.boundary import END, Boundary
from msph.fluid.particles import kernels
from msph.fluid.particles.layers import Layers
from msph.fluid.particles.mirror_images import MirrorImages
from msph.fluid.particles.particles import Particles, one_thread_does
from msph.taichi_internals import data_oriented, kernel

# Coverage sum V_j W (-) above which a cell's centre lies in water. Gaps between particles of mixed
# sizes stay above it.
COVERED = 0.35
# Support of the covering kernel: REACH own spacings plus MARGIN finest spacings. REACH keeps the
# sum in lattices above .5, at a cost that grows with its cube; MARGIN makes coverage fade over a
# cell.
REACH, MARGIN = 1.6, 0.4
# The distance [cells] from a dry cell's centre to the surface is this less the coverages of that
# cell and of its wettest neighbour. Fitted to pools whose level lies at a cell's end and between.
ACROSS = 1.46
# Edge of a cell, in supports of the finest layer, so that a band is at least two cells thick.
CELL = 0.6


@data_oriented
class SurfaceDistance:
    """Distance [m] to the free surface, good to about a fifth of a cell.

    Distances beyond `farthest` [m] are not searched, and read as about `farthest`.
    """

    def __init__(
        self,
        boundary: Boundary,
        layers: Layers,
        particles: Particles,
        farthest: float,
    ):
        self.layers, self.particles = layers, particles
        self.boundary, self.images = boundary, MirrorImages(boundary.box)
        # By the capacity, since the count grows while layers are filled: so one kernel is compiled.
        self.alone = one_thread_does(particles.capacity)
        self.cell = CELL * layers.finest.support
        self.margin = MARGIN * layers.finest.spacing
        self.shape = depth_shape(boundary.box, self.cell)
        self.dims = ti.Vector(list(self.shape))
        self.reach = math.ceil(farthest / self.cell) + 1
        self.coverage = ti.field(ti.f32, shape=self.shape)
        self.air = ti.field(ti.i32, shape=self.shape)
        # Squared distance [cells^2] to the nearest cell of air, and the number of that cell: twice,
        # since each pass reads one and writes the other.
        self.squares, self.nearest = (ti.field(ti.i32, shape=(2, *self.shape)) for _ in range(2))
        # gap: distance from the centre of a cell of air to the surface; depth. Both in cells.
        self.gap, self.depth = (ti.field(ti.f32, shape=self.shape) for _ in range(2))

    def refresh(self) -> None:
        """Measures the depth of every cell anew."""
        self._cover(self.particles.count)
        self._find_air()
        for axis in range(3):
            self._spread(axis % 2, (axis + 1) % 2, axis)
        self._measure()

    @ti.func
    def at(self, x):
        """Depth [m] at x [m]: interpolated between cells, 0 at the surface."""
        g = x / self.cell - 0.5
        base = ti.math.clamp(ti.floor(g, ti.i32), 0, ti.max(self.dims - 2, 0))
        t = ti.math.clamp(g - ti.cast(base, ti.f32), 0.0, 1.0)
        depth = 0.0
        for corner in ti.static(ti.ndrange(2, 2, 2)):
            at, weight = ti.Vector([0, 0, 0]), 1.0
            for k in ti.static(range(3)):
                at[k] = ti.min(base[k] + corner[k], self.dims[k] - 1)
                weight *= corner[k] * t[k] + (1 - corner[k]) * (1.0 - t[k])
            depth += weight * self.depth[at]
        return ti.max(depth, 0.0) * self.cell

    @kernel
    def _cover(self, n: ti.i32):
        """Coverage sum V_j W of the cells' centres, images included."""
        for c in ti.grouped(self.coverage):
            self.coverage[c] = 0.0
        ti.loop_config(serialize=self.alone)
        for i in range(n):
            layer, x = self.particles.layer[i], self.particles.x[i]
            h, volume = REACH * self.layers.spacing[layer] + self.margin, self.layers.volume[layer]
            near = self.images.near(x, h)
            for way in range(self.images.combinations(near)):
                mirror, wall = self.images.seen_in(self.images.combination(way, near))
                self._cover_by(wall + mirror * (x - wall), h, volume)
        if ti.static(self.boundary.count > 0):
            for c in ti.grouped(self.coverage):
                centre = (ti.cast(c, ti.f32) + 0.5) * self.cell
                if self.boundary.clearance(centre, END) < 0.0:
                    self.coverage[c] = 1.0

    @ti.func
    def _cover_by(self, x, h, volume):
        lo, hi = self._first(x[0] - h, 0), self._last(x[0] + h, 0)
        for a in range(lo, hi + 1):
            left = h**2 - ((a + 0.5) * self.cell - x[0]) ** 2
            half = ti.sqrt(ti.max(left, 0.0))
            for b in range(self._first(x[1] - half, 1), self._last(x[1] + half, 1) + 1):
                rest = left - ((b + 0.5) * self.cell - x[1]) ** 2
                deep = ti.sqrt(ti.max(rest, 0.0))
                for c in range(self._first(x[2] - deep, 2), self._last(x[2] + deep, 2) + 1):
                    r2 = h**2 - rest + ((c + 0.5) * self.cell - x[2]) ** 2
                    part = volume * kernels.quartic(ti.sqrt(r2), h)
                    if ti.static(self.alone):
                        # += would be atomic, which one thread does not need.
                        self.coverage[a, b, c] = self.coverage[a, b, c] + part
                    else:
                        self.coverage[a, b, c] += part

    @ti.func
    def _first(self, x, axis: ti.template()):
        """First cell along an axis whose centre lies at x [m] or beyond."""
        return ti.math.clamp(ti.ceil(x / self.cell - 0.5, ti.i32), 0, self.dims[axis] - 1)

    @ti.func
    def _last(self, x, axis: ti.template()):
        """Last cell along an axis whose centre lies at x [m] or before."""
        return ti.math.clamp(ti.floor(x / self.cell - 0.5, ti.i32), 0, self.dims[axis] - 1)

    @kernel
    def _find_air(self):
        """Air is what a block of 2 x 2 x 2 dry cells covers; smaller voids are water."""
        for c in ti.grouped(self.air):
            self.air[c] = 0
        for c in ti.grouped(self.coverage):
            dry = 1
            for corner in ti.static(ti.ndrange(2, 2, 2)):
                at = ti.min(c + ti.Vector(corner), self.dims - 1)
                dry = ti.select(self.coverage[at] < COVERED, dry, 0)
            if dry == 1:
                for corner in ti.static(ti.ndrange(2, 2, 2)):
                    self.air[ti.min(c + ti.Vector(corner), self.dims - 1)] = 1
        for c in ti.grouped(self.air):
            square = ti.select(self.air[c] == 1, 0, self.reach * self.reach)
            self.squares[0, c[0], c[1], c[2]] = square
            self.nearest[0, c[0], c[1], c[2]] = self._number(c)
            self.gap[c] = self._gap(c)

    @ti.func
    def _gap(self, c):
        """Way [cells] from the centre of cell c to the surface, towards its wettest neighbour."""
        wettest, own = 0.0, self.coverage[c]
        for axis in ti.static(range(3)):
            for way in ti.static((-1, 1)):
                at = ti.math.clamp(c + way * ti.Vector.unit(3, axis, ti.i32), 0, self.dims - 1)
                wettest = ti.max(wettest, ti.select(self.air[at] == 1, 0.0, self.coverage[at]))
        return ti.math.clamp(ACROSS - ti.min(wettest, 1.0) - own, 0.0, 1.0)

    @ti.func
    def _number(self, c):
        return (c[0] * self.dims[1] + c[1]) * self.dims[2] + c[2]

    @kernel
    def _spread(self, near: ti.i32, far: ti.i32, axis: ti.i32):
        """squares[far] = min over k of squares[near](cell + k along the axis) + k^2; nearest[far]
        is the cell of air with that minimum."""
        for c in ti.grouped(self.air):
            least, best, k = self.squares[near, c[0], c[1], c[2]], 0, 1
            step = ti.cast(ti.Vector([axis == 0, axis == 1, axis == 2]), ti.i32)
            place, last = c.dot(step), self.dims.dot(step) - 1
            # Search outwards until k^2 alone exceeds the least: at once in air, soon near it.
            while k * k < least:
                for way in ti.static((-k, k)):
                    if 0 <= place + way <= last:
                        at = c + way * step
                        square = self.squares[near, at[0], at[1], at[2]] + k * k
                        if square < least:
                            least, best = square, way
                k += 1
            self.squares[far, c[0], c[1], c[2]] = least
            at = c + best * step
            self.nearest[far, c[0], c[1], c[2]] = self.nearest[near, at[0], at[1], at[2]]

    @kernel
    def _measure(self):
        """Depth of the cells' centres, negative in air."""
        for c in ti.grouped(self.depth):
            number = self.nearest[1, c[0], c[1], c[2]]
            row = number // self.dims[2]
            square = self.squares[1, c[0], c[1], c[2]]
            at = ti.Vector([row // self.dims[1], row % self.dims[1], number % self.dims[2]])
            self.depth[c] = ti.sqrt(ti.cast(square, ti.f32)) - self.gap[at]


def depth_shape(size: tuple[float, float, float], cell: float) -> tuple[int, int, int]:
    """Number of whole cells along x, y and z in a box of `size` [m]; what remains at the far walls
    belongs to the last cells."""
    nx, ny, nz = (max(1, int(edge / cell)) for edge in size)
    return nx, ny, nz
