"""Wet walls and bodies: where water has been, until it has dried.

Wetness is a map of the box with nodes on the walls: near 1 close to vertices of the water's mesh,
whose sides lie on walls and bodies, and decaying elsewhere. One map serves walls, panes and bodies.
"""

import math

import numpy as np
import taichi as ti

from msph.device_table import DeviceTable
from msph.launches import data_oriented, kernel
from msph.picture.rasteriser import BLOCK

# Largest number of cells along an axis; least size of a cell, over the distance between vertices.
CELLS, LEAST_CELL = 40, 1.25
# A vertex wets a node at the distance d [cells] by SHARPNESS (1 - d^2), at most 1: fully between
# vertices, and less with the distance beyond the waterline, for a smooth edge.
SHARPNESS = 1.5
# Time [s] between two decays of the map, each of which may redraw the image without water.
EVERY = 0.25
# Wetness (-) below which a place counts as dry, and smallest change that is visible.
DRY, VISIBLE = 0.02, 0.01
# Decay within the drying time, as an exponent: from 1 to DRY.
LOST = -math.log(DRY)


@data_oriented
class Wetness:
    """Map of wetness. wet (CELLS + 1,) * 3: 0 to 1, by node; drawn: map of the last redraw."""

    def __init__(self, mesh):
        self.mesh = mesh
        self.wet, self.drawn = (ti.field(ti.f32, (CELLS + 1,) * 3) for _ in range(2))
        # last: index of the nodes on the far walls.
        self.numbers = DeviceTable((), per_metre=ti.math.vec3, last=ti.math.vec3)
        self.reset()

    def load(self, box, spacing):
        """Loads a box (Lx, Ly, Lz) [m] with a distance `spacing` [m] between vertices on walls."""
        box = np.asarray(box, float)
        cell = max(box.max() / CELLS, LEAST_CELL * spacing)
        last = np.maximum(np.round(box / cell), 1.0)
        self.numbers.fill(per_metre=last / box, last=last)

    def reset(self):
        """Dries all walls and bodies."""
        self.wet.fill(0.0)
        self.drawn.fill(0.0)

    @ti.func
    def place(self, p):
        """Returns the coordinates of p [m] in cells."""
        return ti.math.clamp(p * self.numbers.per_metre[None], 0.0, self.numbers.last[None])

    @kernel
    def mark(self):
        """Wets the nodes around the mesh's vertices."""
        ti.loop_config(block_dim=BLOCK)
        for v in range(self.mesh.counts[0]):
            c = self.place(self.mesh.vertices[v])
            first = ti.min(ti.floor(c), self.numbers.last[None] - 1.0)
            f = c - first
            for k in range(8):
                corner = ti.Vector([k >> 2, k >> 1 & 1, k & 1])
                found = ti.min(SHARPNESS * (1.0 - (f - corner).norm_sqr()), 1.0)
                node = ti.cast(first, ti.i32) + corner
                if found > self.wet[node]:  # a plain read first: most vertices add nothing
                    ti.atomic_max(self.wet[node], found)

    @kernel
    def decay(self, share: ti.f32):
        """Multiplies the map by a share; values below DRY become 0."""
        for node in ti.grouped(self.wet):
            left = share * self.wet[node]
            self.wet[node] = ti.select(left < DRY, 0.0, left)

    @kernel
    def renew(self) -> ti.i32:
        """Returns the number of nodes that changed visibly since the last redraw, and stores
        the map as drawn."""
        changed = 0
        for node in ti.grouped(self.wet):
            changed += abs(self.wet[node] - self.drawn[node]) > VISIBLE
            self.drawn[node] = self.wet[node]
        return changed

    @ti.func
    def at(self, p, axis, shot: ti.template()):
        """Returns the wetness at p [m], by quadratic B-splines for smooth edges; axis: the wall
        across this axis at p, or 3 inside of the box."""
        found = 0.0
        if shot.drying == 1:
            c, last = self.place(p), ti.cast(self.numbers.last[None], ti.i32)
            i = ti.cast(ti.round(c), ti.i32)
            f = c - i
            low, high = 0.5 * (0.5 - f) ** 2, 0.5 * (0.5 + f) ** 2
            # On a wall, its own nodes suffice: 9 of 27.
            own = ti.Vector([0, 1, 2]) == axis
            e = ti.Matrix([[1 - own[0], own[0], 0], [0, own[2], 1 - own[2]], [0, axis == 3, 0]])
            for n in range(ti.select(axis == 3, 27, 9)):
                a = (n % 3 - 1) * e[0, :] + (n // 3 % 3 - 1) * e[1, :] + (n // 9 - 1) * e[2, :]
                w = ti.select(a < 0, low, ti.select(a > 0, high, 0.75 - f * f))
                w = ti.select(own, 1.0, w)
                cell = ti.math.clamp(i + a, 0, last)
                found += w[0] * w[1] * w[2] * self.wet[cell]
        return found
