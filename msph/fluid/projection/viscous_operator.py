"""Laplacian of velocities, by pair forces along the line of centres.

lap v_i = sum V_j a(r_ij, h_ij) (v_ji.e_ij) e_ij, e_ij = r_ij/r_ij (form of Monaghan 2005, eq. 4.1,
where a = -10 W'/r for a kernel W). The form along v_ij (Morris et al. 1997) brakes rotating water
at surfaces. The weight is a ~ (1 - q^2)^1.5 and not a kernel's slope, which counts few neighbours
(docs/method.md, "Forces").
"""

import math

import taichi as ti

from msph.fluid.parts import Parts
from msph.fluid.small_numbers import MIN_DIVISOR
from msph.taichi_internals import data_oriented

# a = WEIGHT_FACTOR (1 - q^2)^1.5/h^5: the integral of r^2 a over space must be 30.
WEIGHT_FACTOR = 640.0 / math.pi**2
# A particle's own share of lap v, by axis, in 1/h^2: a third of the integral of a over space.
STIFFNESS = 80.0 / 3.0
# Factor of a across a no-slip wall, where the force does not depend on direction: r^2 a must have
# the integral 6.
NO_SLIP_FACTOR = 0.2


@data_oriented
class ViscousOperator:
    """Operator 1 - diffusion lap, symmetric and positive under the volumes V.

    diffusion () is dt nu [m^2]; result (room,) vec3 holds the result of apply().
    """

    def __init__(self, parts: Parts, result: ti.MatrixField):
        self.constants, self.result = parts.constants, result
        self.layers, self.particles = parts.layers, parts.particles
        self.neighbours, self.images = parts.neighbours, parts.neighbours.images
        self.diffusion = ti.field(ti.f32, shape=())

    @ti.func
    def apply(self, n, v: ti.template()):
        """Stores v - diffusion lap v [v's unit]; returns <v, v - diffusion lap v>."""
        total = 0.0
        for i in range(n):
            found = v[i] - self.diffusion[None] * self.laplacian(i, v)
            self.result[i] = found
            total += self.layers.volume[self.particles.layer[i]] * v[i].dot(found)
        return total

    @ti.func
    def response(self, i, v: ti.template()):
        """Returns v - diffusion lap v at particle i, after apply() of v."""
        return self.result[i]

    @ti.func
    def laplacian(self, i, field: ti.template()):
        """Returns lap of a vector field on the particles [its unit / m^2]."""
        x, v, total = self.particles.x[i], field[i], ti.Vector([0.0, 0.0, 0.0])
        layer, slip = self.particles.layer[i], self.constants.slip[None]
        for mirrored in ti.static((False, True)):
            begin, end = self.neighbours.span(i, mirrored)
            for s in range(begin, end):
                j, mirror, wall = self.neighbours.read(s, mirrored)
                r_ij = self.images.offset(x, self.particles.x[j], mirror, wall)
                other, r2 = self.particles.layer[j], r_ij.norm_sqr()
                per_h = self.layers.per_h[layer, other]
                u = ti.max(1.0 - r2 * per_h * per_h, 0.0)
                weight = self.layers.volume[other] * WEIGHT_FACTOR * per_h**5 * u * ti.sqrt(u)
                weight /= ti.max(r2, MIN_DIVISOR)  # V_j a/r^2 [1/m^4]
                along = (mirror * field[j] - v).dot(r_ij) * r_ij
                if ti.static(mirrored):
                    # Images move against the water, so that the velocity is 0 at the wall.
                    against = -NO_SLIP_FACTOR * r2 * (field[j] + v)
                    along = ti.select(slip == 1, along, against)
                total += weight * along
        return total
