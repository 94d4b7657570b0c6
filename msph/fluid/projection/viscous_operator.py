"""The Laplacian of velocities, by pair forces along the line of centres.

lap v_i = sum V_j a(r_ij, h_ij) (v_ji.e_ij) e_ij, e_ij = r_ij/r_ij (form of Monaghan 2005, eq. 4.1,
which for a kernel W has a = -10 W'/r). The more usual form along v_ij (Morris et al. 1997) brakes
turning water wherever there is a surface.

The weight a is not taken from the pressure's kernel, whose slope is so narrow that few neighbours
count: with Wendland C2 a shear wave on a cubic lattice decays with .59 to 1.57 times the viscosity
asked for, by its direction; with a ~ (1 - q^2)^1.5 with 1.02 to 1.05.
"""

import math

import taichi as ti

from msph.fluid.constants import Constants
from msph.fluid.particles.layers import Layers
from msph.fluid.particles.neighbour_list import NeighbourList
from msph.fluid.particles.particles import Particles
from msph.taichi_internals import data_oriented

# a = WEIGHT (1 - q^2)^1.5/h^5: the integral of r^2 a over space must be 30.
WEIGHT = 640.0 / math.pi**2
# A particle's own share of lap v, by axis, in 1/h^2: a third of the integral of a over space.
STIFFNESS = 80.0 / 3.0
# Across a wall without slip nothing depends on the direction: r^2 a must have the integral 6.
NO_SLIP = 0.2
# Keeps divisions by what may vanish finite [m^2].
TINY = 1e-30


@data_oriented
class ViscousOperator:
    """1 - span lap, symmetric and positive under the volumes V; span [m^2] = dt nu is a field of
    shape (). product (room,) vec3 holds what apply() found."""

    def __init__(
        self,
        constants: Constants,
        layers: Layers,
        particles: Particles,
        neighbours: NeighbourList,
        product: ti.MatrixField,
    ):
        self.layers, self.particles, self.neighbours = layers, particles, neighbours
        self.images, self.constants, self.product = neighbours.images, constants, product
        self.span = ti.field(ti.f32, shape=())

    @ti.func
    def apply(self, n, v: ti.template()):
        """product = v - span lap v [v's unit]; returns <v, product> = sum V v.product."""
        total = 0.0
        for i in range(n):
            found = v[i] - self.span[None] * self.laplacian(i, v)
            self.product[i] = found
            total += self.layers.volume[self.particles.layer[i]] * v[i].dot(found)
        return total

    @ti.func
    def response(self, i, v: ti.template()):
        """v - span lap v at particle i, after apply() of v."""
        return self.product[i]

    @ti.func
    def laplacian(self, i, field: ti.template()):
        """lap of a vector field on the particles [its unit / m^2]."""
        x, v, total = self.particles.x[i], field[i], ti.Vector([0.0, 0.0, 0.0])
        layer, slip = self.particles.layer[i], self.constants.slip[None]
        for mirrored in ti.static((False, True)):
            begin, end = self.neighbours.span(i, mirrored)
            for s in range(begin, end):
                j, mirror, wall = self.neighbours.read(s, mirrored)
                r_ij = self.images.offset(x, self.particles.x[j], mirror, wall)
                weight = self.weight(layer, j, r_ij)
                along = (mirror * field[j] - v).dot(r_ij) * r_ij
                if ti.static(mirrored):
                    # Images move against the water, so that it stands at the wall.
                    against = -NO_SLIP * r_ij.norm_sqr() * (field[j] + v)
                    along = ti.select(slip == 1, along, against)
                total += weight * along
        return total

    @ti.func
    def weight(self, layer, j, r_ij):
        """V_j a/r^2 [1/m^4]."""
        other = self.particles.layer[j]
        per_h, r2 = self.layers.per_h[layer, other], r_ij.norm_sqr()
        u = ti.max(1.0 - r2 * per_h * per_h, 0.0)
        return self.layers.volume[other] * WEIGHT * per_h**5 * u * ti.sqrt(u) / ti.max(r2, TINY)
