"""Bodies at the surface: the part of a kernel outside of bodies, and the cut of the surface.

The surface is where f = min(coverage - iso, s/l) is zero, with s the distance to the nearest body
and l the length over which coverage falls: the mesh is closed along bodies. Coverage is divided by
the part of the kernel's ball outside of bodies, as at the walls. This part is taken from the
fluid's kernel, which is narrower than poly6: at the side of a body the coverage of still water is
up to 6 % low, which moves the surface there by less than 0.1 spacings.
"""

import taichi as ti

from msph.device_table import DeviceTable
from msph.fluid.boundary.body_shapes import END
from msph.fluid.boundary.boundary import Boundary
from msph.launches import data_oriented

vec4 = ti.math.vec4

# Least part (-) of a kernel outside of bodies, against division by zero inside bodies.
MIN_OPEN = 0.1


@data_oriented
class Bodies:
    """The bodies of `boundary` at the end of a step; not used by kernels for scenes without
    bodies."""

    def __init__(self, boundary: Boundary | None, numbers: DeviceTable):
        self.boundary, self.numbers = boundary, numbers

    @ti.func
    def clearance(self, x):
        """Returns the distance [m] from x to the nearest body, negative inside a body."""
        return self.boundary.clearance(x, END)

    @ti.func
    def open_share(self, x, layer):
        """Returns the part F (-) of a layer's kernel around x [m] outside of bodies, and its
        gradient [1/m]."""
        found = self.boundary.open_share(x, layer, END)
        if found[0] < MIN_OPEN:
            found = vec4(MIN_OPEN, 0.0, 0.0, 0.0)
        return found

    @ti.func
    def cut(self, x):
        """Returns s/l (-) of the nearest body at x [m], and its gradient [1/m]."""
        nearest = vec4(1e9, 0.0, 0.0, 0.0)
        for b in range(self.numbers.bodies[None]):
            found = self.boundary.distance(b, x, END)
            if found[0] < nearest[0]:
                nearest = found
        return self.numbers.slope[None] * nearest
