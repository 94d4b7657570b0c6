"""Mirrors: which walls of the box mirror a place, and mirror images of places and vectors.

A combination of walls, at most one per axis, is a set of bits: 0 to 2 for the mirrored axes, 3 to 5
for those of them whose mirror is the far wall.
"""

import taichi as ti

from msph.fluid.boundary.apertures import Apertures
from msph.fluid.constants import Constants
from msph.launches import data_oriented

# Bit of the floor among the walls.
FLOOR = 1 << 1


@data_oriented
class Mirrors:
    """Mirrors of the walls, edges and corners of the box.

    Exact if the box's edges are at least one support long: in shorter boxes images of images would
    be within reach.
    """

    def __init__(self, constants: Constants):
        self.walls, self.rim = constants.walls, constants.rim  # [m]
        self.covered = constants.covered
        self.apertures = Apertures(constants)

    @ti.func
    def walls_near(self, x, reach):
        """Returns the walls within `reach` [m] of x as bits: 0 to 2 at the origin, 3 to 5
        opposite. Above the rim and behind pistons, walls mirror nothing."""
        # Reading a single component would disable reductions per thread in the calling loop.
        walls, found = self.walls[None], 0
        for k in ti.static(range(3)):
            found |= ti.select(x[k] < reach, 1 << k, 0)
            found |= ti.select(walls[k] - x[k] < reach, 8 << k, 0)
        return ti.select(self.is_mirrored(x), found, found & FLOOR) & ~self.covered[None]

    @ti.func
    def is_mirrored(self, x):
        """Returns True if side walls mirror a particle at x [m]."""
        return x.y <= self.rim[None]

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
        """Returns the part of mirror bits that is by these walls, bits of walls_near()."""
        far = (mirrors >> 3) & (walls >> 3) & 7
        low = mirrors & ~(mirrors >> 3) & walls & 7
        return low | far | (far << 3)

    @ti.func
    def mirror_and_wall(self, mirrors):
        """Returns the mirrored vectors' factors (-1 along mirrored axes) and the walls [m]."""
        bits = ti.Vector([mirrors, mirrors >> 1, mirrors >> 2])
        low, far = ti.cast(bits & 1, ti.f32), ti.cast((bits >> 3) & 1, ti.f32)
        return 1.0 - 2.0 * low, self.walls[None] * far

    @ti.func
    def reflected(self, x, mirror, wall):
        """Returns the mirror image [m] of a position x [m]."""
        return wall + mirror * (x - wall)

    @ti.func
    def offset(self, x, x_j, mirror, wall):
        """Returns r_ij [m], from the image of x_j to x."""
        return (x - wall) + mirror * (wall - x_j)
