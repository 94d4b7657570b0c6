"""Bodies in the water, as its surface meets them: the part of a kernel outside of them, and a cut.

The surface of the water is where f = min(coverage - iso, s/l) is zero, s the distance to the
nearest body and l the length over which coverage falls: the mesh ends on bodies and is closed along
them. The coverage beside a body is completed by the part of the kernel's ball outside of it, as at
the box's walls. That part is the boundary's, of the water's own kernel, which is narrower than
poly6: beside a wall the coverage of still water comes out up to 6 % low, which moves a surface
that meets the wall by less than a tenth of a spacing.
"""

import taichi as ti

from msph.device_table import DeviceTable
from msph.fluid.boundary.boundary import END, Boundary
from msph.taichi_internals import data_oriented

vec4 = ti.math.vec4

# Least part (-) of a kernel taken as open: less has no place outside of bodies. Against division
# by zero within them.
LEAST_OPEN = 0.1


@data_oriented
class Bodies:
    """The bodies of `boundary` at the end of a step. Kernels for scenes without bodies are compiled
    without any of this."""

    def __init__(self, boundary: Boundary | None, numbers: DeviceTable):
        self.boundary, self.numbers = boundary, numbers

    @ti.func
    def clearance(self, x):
        """Distance [m] of x to the nearest body, negative inside of one."""
        return self.boundary.clearance(x, END)

    @ti.func
    def open_share(self, x, layer):
        """The part F (-) of a layer's kernel round x [m] outside of all bodies, and its gradient
        [1/m]."""
        found = self.boundary.open_share(x, layer, END)
        if found[0] < LEAST_OPEN:
            found = vec4(LEAST_OPEN, 0.0, 0.0, 0.0)
        return found

    @ti.func
    def cut(self, x):
        """s/l (-) of the nearest body at x [m], and its gradient [1/m]."""
        nearest = vec4(1e9, 0.0, 0.0, 0.0)
        for b in range(self.numbers.bodies[None]):
            found = self.boundary.distance(b, x, END)
            if found[0] < nearest[0]:
                nearest = found
        return self.numbers.slope[None] * nearest
