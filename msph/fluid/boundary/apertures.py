"""Cross-sections of the openings, for kernels: where walls are open, where velocities are
prescribed, and where water is removed. openings.py fills the table `constants.openings`.

An opening has a coordinate s [m] along its direction of flow, 0 at its cross-section.
"""

import taichi as ti

from msph.fluid.constants import Constants
from msph.fluid.small_numbers import MIN_DIVISOR
from msph.launches import data_oriented

vec3 = ti.math.vec3


@data_oriented
class Apertures:
    """The openings of the present scene; all results are 0 or False without any."""

    def __init__(self, constants: Constants):
        self.constants, self.table = constants, constants.openings

    @ti.func
    def beyond(self, x):
        """Returns the walls beyond which x [m] lies, as bits (Walls.near)."""
        found, walls = 0, self.constants.walls[None]
        for k in ti.static(range(3)):
            found |= ti.select(x[k] < 0.0, 1 << k, 0) | ti.select(x[k] > walls[k], 8 << k, 0)
        return found

    @ti.func
    def near(self, x, reach):
        """Returns the openings, as bits, in which the way from x [m] to a mirror image within
        `reach` [m] can cross a wall."""
        found = 0
        for o in range(self.constants.opening_count[None]):
            if abs(self.along(o, x)) <= reach and self._faces(o, x, reach):
                found |= 1 << o
        return found

    @ti.func
    def visible(self, x, x_j, mirrors, openings):
        """Returns True if the way from x [m] to the mirror image of x_j [m] by `mirrors` (bits of
        walls) passes through no opening; openings: those near() x. The result is the same if x and
        x_j are exchanged, so that forces are equal and opposite."""
        return (self.crossed(x, x_j, openings) & mirrors) == 0

    @ti.func
    def crossed(self, x, x_j, openings):
        """Returns the walls, as bits, whose mirror image of x_j [m] is not visible at x [m];
        openings: those near() x."""
        crossed = self.beyond(x) | self.beyond(x_j)
        for o in range(ti.select(openings > 0, self.constants.opening_count[None], 0)):
            if (openings >> o) & 1:
                a, b = abs(self.along(o, x)), abs(self.along(o, x_j))
                place = (b * x + a * x_j) / ti.max(a + b, MIN_DIVISOR)
                if self._faces(o, place, self.table.edge[o]):
                    crossed |= self.table.wall[o]
        return crossed

    @ti.func
    def passable(self, x):
        """Returns the walls, as bits, with a hole through which a particle can leave at x [m]."""
        found = 0
        for o in range(self.constants.opening_count[None]):
            if self.table.leaves[o] == 1 and self._faces(o, x, 0.0):
                found |= self.table.wall[o]
        return found

    @ti.func
    def prescriber(self, x):
        """Returns 1 + the index of the opening that prescribes the velocity at x [m], or 0."""
        found = 0
        for o in range(self.constants.opening_count[None]):
            s = self.along(o, x)
            inside = self.table.zone_begin[o] <= s and s < 0.0
            if inside and self._faces(o, x, self.table.slack[o]):
                found = 1 + o
        return found

    @ti.func
    def holds(self, x):
        """Returns True if x [m], beyond a wall, is in a pipe or in the jet through a hole."""
        found, beyond = False, self.beyond(x)
        for o in range(self.constants.opening_count[None]):
            s = self.along(o, x) - self.table.kept_from[o]
            kept = (self.table.wall[o] & beyond) != 0 and s >= 0.0 and s < self.table.length[o]
            # A jet bends by less than its length.
            found = found or (kept and self._faces(o, x, self.table.length[o]))
        return found

    @ti.func
    def removes(self, x):
        """Returns True if an outflow in the box removes water at x [m]."""
        found = False
        for o in range(self.constants.opening_count[None]):
            s = self.along(o, x)
            inside = self.table.leaves[o] == 1 and self.table.wall[o] == 0
            removed = inside and s >= 0.0 and s < self.table.length[o]
            found = found or (removed and self._faces(o, x, self.table.slack[o]))
        return found

    @ti.func
    def leaves_by_opening(self, x):
        """Returns True if water that is removed at x [m] left through an opening, and False if it
        left over the rim."""
        beyond = self.beyond(x)
        found = beyond == 0 and x.y <= self.constants.ceiling[None]
        for o in range(self.constants.opening_count[None]):
            through = (self.table.wall[o] & beyond) != 0
            found = found or (through and self._faces(o, x, 2.0 * self.table.length[o]))
        return found

    @ti.func
    def along(self, o, x):
        """Returns the coordinate [m] of x [m] along the flow of opening o."""
        return (x - self.table.centre[o]).dot(self.table.along[o])

    @ti.func
    def _faces(self, o, x, margin):
        """Returns True if x [m] is before or behind the cross-section widened by `margin` [m]."""
        r = x - self.table.centre[o]
        a, b = r.dot(self.table.across[o]), r.dot(self.table.aslant[o])
        width, height = self.table.width[o] + margin, self.table.height[o] + margin
        disc = a * a + b * b <= width * width
        rectangle = abs(a) <= width and abs(b) <= height
        return ti.select(self.table.round[o] == 1, disc, rectangle)
