"""Wet walls and bodies: where water has been, until it has dried.

A map of the box, CELLS along its longest edge: 1 in cells with a vertex of the water's mesh, whose
sides lie on walls and bodies; elsewhere it decays. One map serves walls, panes and bodies.
"""

import math

import taichi as ti

from msph.picture.rasteriser import BLOCK
from msph.taichi_internals import data_oriented, kernel

CELLS = 40
# Time between two decays of the map, each of which renders the image without water again [s].
EVERY = 0.25
# Wetness (-) up to which a place counts as dry, and above which as wet.
DRY, WET = 0.02, 0.98
# Decay within the drying time, as an exponent: from 1 to DRY.
LOST = -math.log(DRY)


@data_oriented
class Wetness:
    """wet (CELLS,) * 3: 0 to 1, by place in the box."""

    def __init__(self, mesh, lens):
        self.mesh, self.lens = mesh, lens
        self.wet = ti.field(ti.f32, (CELLS,) * 3)
        self.reset()

    def reset(self):
        """Dries everything."""
        self.wet.fill(0.0)

    @ti.func
    def place(self, p, shot: ti.template()):
        """Returns the place of p [m] in cells."""
        return ti.math.clamp(p * (CELLS / shot.size.max()), 0.0, CELLS - 0.001)

    @kernel
    def mark(self):
        """Wets the cells of the mesh's vertices."""
        ti.loop_config(block_dim=BLOCK)
        for v in range(self.mesh.counts[0]):
            c = ti.cast(self.place(self.mesh.vertices[v], self.lens.shot[None]), ti.i32)
            self.wet[c.x, c.y, c.z] = 1.0

    @kernel
    def decay(self, share: ti.f32) -> ti.i32:
        """Multiplies the map by a share; returns the number of cells that are drying."""
        drying = 0
        for i, j, k in self.wet:
            left = share * self.wet[i, j, k]
            if left < DRY:
                left = 0.0
            self.wet[i, j, k] = left
            drying += left > 0.0 and left < WET * share
        return drying

    @ti.func
    def at(self, p, shot: ti.template()):
        """Returns the wetness at p [m], by quadratic B-splines: smooth edges."""
        found = 0.0
        if shot.drying == 1:
            c = self.place(p, shot)
            i = ti.cast(c, ti.i32)
            f = c - i - 0.5
            low, high = 0.5 * (0.5 - f) ** 2, 0.5 * (0.5 + f) ** 2
            for n in range(27):
                a = ti.Vector([n % 3, n // 3 % 3, n // 9]) - 1
                w = ti.select(a < 0, low, ti.select(a > 0, high, 0.75 - f * f))
                cell = ti.math.clamp(i + a, 0, CELLS - 1)
                found += w[0] * w[1] * w[2] * self.wet[cell.x, cell.y, cell.z]
        return found
