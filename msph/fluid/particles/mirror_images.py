"""Mirror images: every wall of the box is a mirror for the particles near it.

The part of a kernel beyond a wall is filled by the mirror images of the particles within reach. So
a particle at a wall has the density of one in bulk, pressures balance, and images move with the
reflected velocity. Images are not stored as particles. An image of j is never nearer to i than j
is, so the images within reach are found among the neighbours.

The alternative, a wall of constant density (the kernel's integral behind a plane), transmits half
of the pressure force: see docs/method.md, "Walls and bodies".
"""

import taichi as ti

from msph.fluid.constants import Constants
from msph.taichi_internals import data_oriented

# Bits of an entry of the neighbour list: 24 for the neighbour's index, then one per axis that is
# mirrored, then one per axis whose mirror is the far wall.
INDEX_BITS = 24
INDEX_MASK = (1 << INDEX_BITS) - 1


@data_oriented
class MirrorImages:
    """Mirror images in the walls, edges and corners of the box.

    Exact for boxes whose edges are at least a support long: in shorter ones images of images would
    be within reach.
    """

    def __init__(self, constants: Constants):
        self.size = constants.size  # [m]

    @ti.func
    def walls_near(self, x, reach):
        """Bits of the walls less than `reach` [m] away from x: three for the walls at 0, by axis,
        then three for the far walls."""
        # The whole vector: a load of one component would cost the sums by thread of any loop.
        size, found = self.size[None], 0
        for k in ti.static(range(3)):
            found |= ti.select(x[k] < reach, 1 << k, 0)
            found |= ti.select(size[k] - x[k] < reach, 8 << k, 0)
        return found

    @ti.func
    def combinations(self, near):
        """Number of combinations of `near` walls, at most one per axis: none (the particle itself),
        one wall, two (an edge), three (a corner)."""
        product = 1
        for k in ti.static(range(3)):
            product *= 1 + ((near >> k) & 1) + ((near >> (k + 3)) & 1)
        return product

    @ti.func
    def combination(self, way, near):
        """Bits of the mirrors of combination number `way`; the zeroth has none."""
        mirrors, rest = 0, way
        for k in ti.static(range(3)):
            low, far = (near >> k) & 1, (near >> (k + 3)) & 1
            digit = rest % (1 + low + far)
            rest //= 1 + low + far
            mirrors |= ti.select(digit > 0, 1 << k, 0) | ti.select(digit > low, 8 << k, 0)
        return mirrors

    @ti.func
    def mirror_and_wall(self, mirrors):
        """Factors of vectors seen in the mirrors, -1 along mirrored axes, and the walls' places
        [m]."""
        sign, wall = ti.Vector([1.0, 1.0, 1.0]), ti.Vector([0.0, 0.0, 0.0])
        size = self.size[None]
        for k in ti.static(range(3)):
            sign[k] -= 2.0 * ti.cast((mirrors >> k) & 1, ti.f32)
            wall[k] = size[k] * ti.cast((mirrors >> (k + 3)) & 1, ti.f32)
        return sign, wall

    @ti.func
    def entry(self, j, mirrors):
        return j | (mirrors << INDEX_BITS)

    @ti.func
    def neighbour(self, entry):
        """Neighbour of an entry."""
        return entry & INDEX_MASK

    @ti.func
    def read(self, entry):
        """Neighbour j of an entry, and the mirror and wall that it is seen in: its vector v appears
        as mirror * v, its place by offset()."""
        mirror, wall = self.mirror_and_wall(entry >> INDEX_BITS)
        return self.neighbour(entry), mirror, wall

    @ti.func
    def offset(self, x, x_j, mirror, wall):
        """r_ij [m]: x less the place at which x_j is seen."""
        return (x - wall) + mirror * (wall - x_j)
