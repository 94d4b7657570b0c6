"""Walls of the box: where they stop and mirror particles, with a lid or with an open top.

A combination of walls, at most one per axis, is a set of bits: 0 to 2 for the mirrored axes, 3 to 5
for those of them whose mirror is the far wall.

With an open top, the side walls end at the rim, the height of the box, and there is no lid. Water
above the rim leaves the box over a side wall (rim.py).
"""

from typing import Any

import taichi as ti

from msph.fluid.boundary.apertures import Apertures
from msph.fluid.constants import Constants
from msph.fluid.room import MAX_BODIES
from msph.launches import data_oriented

vec3 = ti.math.vec3

Size = tuple[float, float, float]

# Height above an open top in which grids and surface resolve the water, over the box's shortest
# edge. Water above this height is simulated, too.
HEADROOM = 0.5
# Height above the rim, in longest edges, above which water counts as spilt, so that water that
# never falls back leaves the simulation.
HIGHEST = 4.0
# Bits of the floor and of the side walls among the walls.
FLOOR, SIDES = 1 << 1, 1 | 4 | 8 | 32
# Coordinate [m] of a wall that does not exist; number of walls; row of all walls in the tables of
# bodies, which stays 0: they do not move.
NO_WALL, WALLS, WALL = 1e9, 6, MAX_BODIES


def region(size: Size, open_top: bool) -> Size:
    """Returns the extent [m] of grids and surface for a box of `size` [m]."""
    return size[0], size[1] + HEADROOM * min(size) * open_top, size[2]


def wall_constants(size: Size, open_top: bool) -> dict[str, Any]:
    """Returns the walls' constants by their names in Constants."""
    if not open_top:
        return {"size": size, "walls": size, "rim": NO_WALL, "ceiling": NO_WALL}
    ceiling = size[1] + HIGHEST * max(size)
    walls = (size[0], NO_WALL, size[2])
    return {"size": size, "walls": walls, "rim": size[1], "ceiling": ceiling}


@data_oriented
class Walls:
    """Walls at the coordinates 0 and `walls` [m]; side walls end at the height `rim` [m]. Walls are
    open at inflows and outflows (openings.py).

    Mirrors of walls, edges and corners are exact if the box's edges are at least one support long:
    in shorter boxes images of images would be within reach.
    """

    def __init__(self, constants: Constants):
        self.constants, self.apertures = constants, Apertures(constants)

    @ti.func
    def confined(self, start, end, margin):
        """Returns `end` [m], moved to the distance `margin` [m] from the walls if they stop the way
        from `start` [m]. Side walls stop no particle that is above the rim or was outside."""
        lo, hi = vec3(margin), self.constants.walls[None] - margin
        if end.y > self.constants.rim[None] or self.apertures.beyond(start) & SIDES != 0:
            lo, hi = vec3(-NO_WALL, margin, -NO_WALL), vec3(NO_WALL)
        if self.constants.opening_count[None] > 0:
            passed = self.apertures.passable(end) | self.apertures.beyond(start)
            for k in ti.static(range(3)):
                lo[k] = ti.select((passed >> k) & 1 == 1, -NO_WALL, lo[k])
                hi[k] = ti.select((passed >> (k + 3)) & 1 == 1, NO_WALL, hi[k])
        return ti.math.clamp(end, lo, hi)

    @ti.func
    def near(self, x, reach):
        """Returns the walls within `reach` [m] of x as bits: 0 to 2 at the origin, 3 to 5
        opposite. Above the rim and behind pistons, walls mirror nothing."""
        # Reading a single component would disable reductions per thread in the calling loop.
        walls, found = self.constants.walls[None], 0
        for k in ti.static(range(3)):
            found |= ti.select(x[k] < reach, 1 << k, 0)
            found |= ti.select(walls[k] - x[k] < reach, 8 << k, 0)
        return ti.select(self.is_mirrored(x), found, found & FLOOR) & ~self.constants.covered[None]

    @ti.func
    def is_mirrored(self, x):
        """Returns True if side walls mirror a particle at x [m]."""
        return x.y <= self.constants.rim[None]

    @ti.func
    def combinations(self, near):
        """Returns the number of subsets of `near` walls with at most one wall per axis."""
        product = 1
        for k in ti.static(range(3)):
            product *= 1 + ((near >> k) & 1) + ((near >> (k + 3)) & 1)
        return product

    @ti.func
    def combination(self, number, near):
        """Returns the mirror bits of subset `number`; subset 0 has no mirror."""
        mirrors, rest = 0, number
        for k in ti.static(range(3)):
            low, far = (near >> k) & 1, (near >> (k + 3)) & 1
            digit = rest % (1 + low + far)
            rest //= 1 + low + far
            mirrors |= ti.select(digit > 0, 1 << k, 0) | ti.select(digit > low, 8 << k, 0)
        return mirrors

    @ti.func
    def by_walls(self, mirrors, walls):
        """Returns the part of mirror bits that is by these walls, bits of near()."""
        far = (mirrors >> 3) & (walls >> 3) & 7
        low = mirrors & ~(mirrors >> 3) & walls & 7
        return low | far | (far << 3)

    @ti.func
    def mirror_and_wall(self, mirrors):
        """Returns the mirrored vectors' factors (-1 along mirrored axes) and the walls [m]."""
        bits = ti.Vector([mirrors, mirrors >> 1, mirrors >> 2])
        low, far = ti.cast(bits & 1, ti.f32), ti.cast((bits >> 3) & 1, ti.f32)
        return 1.0 - 2.0 * low, self.constants.walls[None] * far

    @ti.func
    def reflected(self, x, mirror, wall):
        """Returns the mirror image [m] of a position x [m]."""
        return wall + mirror * (x - wall)

    @ti.func
    def offset(self, x, x_j, mirror, wall):
        """Returns r_ij [m], from the image of x_j to x."""
        return (x - wall) + mirror * (wall - x_j)
