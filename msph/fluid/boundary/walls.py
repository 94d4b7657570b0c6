"""Walls of the box: where they stop and mirror particles, with a lid or with an open top.

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
    open at inflows and outflows (openings.py)."""

    def __init__(self, constants: Constants):
        self.constants, self.apertures = constants, Apertures(constants)

    @ti.func
    def confined(self, start, end, margin):
        """Returns `end` [m], moved to the distance `margin` [m] from the walls if they stop the way
        from `start` [m]. Side walls stop no particle that is above the rim or was outside."""
        lo, hi = vec3(margin), self.constants.walls[None] - margin
        if end.y > self.constants.rim[None] or self.is_outside(start):
            lo, hi = vec3(-NO_WALL, margin, -NO_WALL), vec3(NO_WALL)
        if self.constants.opening_count[None] > 0:
            passed = self.apertures.passable(end) | self.apertures.beyond(start)
            for k in ti.static(range(3)):
                lo[k] = ti.select((passed >> k) & 1 == 1, -NO_WALL, lo[k])
                hi[k] = ti.select((passed >> (k + 3)) & 1 == 1, NO_WALL, hi[k])
        return ti.math.clamp(end, lo, hi)

    @ti.func
    def is_outside(self, x):
        """Returns True if x [m] is beyond a side wall, which only an open top allows."""
        beyond = x - self.constants.walls[None]
        return ti.min(x.x, x.z) < 0.0 or ti.max(beyond.x, beyond.z) > 0.0
