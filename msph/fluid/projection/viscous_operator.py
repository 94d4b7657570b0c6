"""Laplacian of velocities, by pair forces along the line of centres, and friction of walls.

lap v_i = sum V_j a(r_ij, h_ij) (v_ji.e_ij) e_ij, e_ij = r_ij/r_ij (form of Monaghan 2005, eq. 4.1,
where a = -10 W'/r for a kernel W). The form along v_ij (Morris et al. 1997) brakes rotating water
at surfaces. The weight is a ~ (1 - q^2)^1.5 and not a kernel's slope, which counts few neighbours
(docs/method.md, "Forces").

A wall without slip brakes a particle at the distance y as images with the velocity -v_i z/y at the
depths z would, which is exact for linear shear. Particles near a wall also exchange momentum with
the images of their neighbours by the difference of v/y, which makes the friction exact for a
parabola.
"""

import math

import taichi as ti

from msph.fluid.projection.discretisation import Discretisation
from msph.fluid.small_numbers import MIN_DIVISOR
from msph.launches import data_oriented

# Factor of all viscous forces: sums over the pairs of water that has settled are too small by 1.2 %
# (docs/method.md, "Forces").
CALIBRATION = 1.012
# a = WEIGHT_FACTOR (1 - q^2)^1.5/h^5: the integral of r^2 a over listed pairs must be 30. Within
# PAIR_REACH = 0.95 of the support lies 1/1.01469 of the integral over the whole support.
WEIGHT_FACTOR = 1.01469 * 640.0 / math.pi**2
# A particle's own share of lap v, by axis, in 1/h^2: a third of the integral of a over space.
STIFFNESS = 80.0 / 3.0
# Factor of a in the exchange of v/y: 3 along the line of centres; without a direction a sixth of
# it, as the integrals of z^3 a behind a wall have the ratio 1 : 6.
EXCHANGE_FACTOR = 0.5
# Least distance from a wall in its friction, in h: the solve takes more iterations with less.
MIN_WALL_DISTANCE = 0.1


@data_oriented
class ViscousOperator(Discretisation):
    """Operator 1 - diffusion lap, symmetric and positive under the volumes V.

    diffusion () is dt nu [m^2]; result (room,) vec3 holds the result of apply(). stiffness
    (entries,) is V_j a/|g|^2 of each entry of the neighbour list, whose gradient g is along r_ij.
    """

    def __init__(self, shared: Discretisation, result: ti.MatrixField):
        super().__init__(shared)
        self.result = result
        self.stiffness = ti.field(ti.f32, shape=self.neighbours.index.shape)
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
        for s in range(self.neighbours.start[i], self.neighbours.end[i]):
            g = self.pair_gradient[s]
            total += self.stiffness[s] * (field[self.neighbours.index[s]] - v).dot(g) * g
        for s in range(self.particles.first_image[i], self.particles.body_image[i]):
            j, r_ij = self.images.index[s], self.images.arm[s]
            other, x_j = self.particles.layer[j], self.particles.x[j]
            mirror, wall = self.walls.mirror_and_wall(self.images.mirrors[s])
            y = wall_distance(x, self.layers.support[layer], mirror, wall)
            y_j = wall_distance(x_j, self.layers.support[other], mirror, wall)
            exchange = EXCHANGE_FACTOR * (field[j] - y_j / y * v)
            exchange *= ti.cast(mirror.sum() > 0.0, ti.f32)  # a single wall
            along = (mirror * field[j] - v).dot(r_ij) * r_ij / ti.max(r_ij.norm_sqr(), MIN_DIVISOR)
            weight = self._weight(layer, other, r_ij)
            total += weight * ti.select(slip == 1, along, exchange)
        return CALIBRATION * (total - self.particles.wall_friction[i] * v)

    @ti.func
    def _weight(self, layer, other, r_ij):
        """Returns V_j a [1/m^2] of a particle of the layer `other` at -r_ij [m]."""
        per_h = self.layers.per_h[layer, other]
        u = ti.max(1.0 - r_ij.norm_sqr() * per_h * per_h, 0.0)
        return self.layers.volume[other] * WEIGHT_FACTOR * per_h**5 * u * ti.sqrt(u)

    @ti.func
    def prepare(self, i):
        """Stores the stiffness of the neighbours of particle i, and the friction of the walls there
        [1/m^2], which laplacian() reads."""
        layer, x = self.particles.layer[i], self.particles.x[i]
        for s in range(self.neighbours.start[i], self.neighbours.end[i]):
            j = self.neighbours.index[s]
            weight = self._weight(layer, self.particles.layer[j], x - self.particles.x[j])
            square = self.pair_gradient[s].norm_sqr()
            self.stiffness[s] = weight / ti.max(square, MIN_DIVISOR)
        self._set_wall_friction(i)

    @ti.func
    def _set_wall_friction(self, i):
        x, h = self.particles.x[i], self.layers.support[self.particles.layer[i]]
        crossed = self.apertures.crossed(x, x, self.apertures.near(x, h))
        near = self.walls.near(x, h) & ~crossed
        walls, found = self.constants.walls[None], 0.0
        for k in ti.static(range(3)):
            low, far = wall_friction(x[k], h), wall_friction(walls[k] - x[k], h)
            found += ti.select((near >> k) & 1 == 1, low, 0.0)
            found += ti.select((near >> (k + 3)) & 1 == 1, far, 0.0)
        self.particles.wall_friction[i] = ti.select(self.constants.slip[None] == 1, 0.0, found)


@ti.func
def wall_distance(x, h, mirror, wall):
    """Returns the distance [m] of x from the wall that mirrors, at least MIN_WALL_DISTANCE h."""
    return ti.max(0.5 * abs((1.0 - mirror).dot(x - wall)), MIN_WALL_DISTANCE * h)


@ti.func
def wall_friction(y, h):
    """Returns the friction [1/m^2] of a plane at the distance y [m]: the integral of a (z/y) e^2
    behind it, e^2 = (1 - z^2/r^2)/2 the mean square of e_ij along the plane.

    With Y = y/h and c^2 = 1 - Y^2: 80/(pi Y h^2) (2/5 c^5 (1 - 2 Y^2) - 2/7 c^7 + 2 Y^4 (artanh c -
    c - c^3/3)). Times y, its integral over y is 1.
    """
    y2 = ti.math.clamp(y / h, MIN_WALL_DISTANCE, 1.0) ** 2
    c2 = 1.0 - y2
    c = ti.sqrt(c2)
    rest = ti.log((1.0 + c) / ti.sqrt(y2)) - c * (1.0 + c2 / 3.0)
    found = c**5 * (0.4 * (1.0 - 2.0 * y2) - c2 / 3.5) + 2.0 * y2 * y2 * rest
    return 80.0 / math.pi * found / (ti.sqrt(y2) * h * h)
