"""The discrete gradient of pressure and the divergence that is adjoint to it.

Multipliers q [m^2] displace particles by u_i = -sum V_j (q_i + q_j) grad W_ij [m], which changes
their relative densities by sum V_j (u_i - u_j).grad W_ij. Sums run over neighbours and their mirror
images; bodies add -q_i b_i to the one and u_i.b_i to the other, b_i the gradient of their part of
the kernel's integral. Divergence and gradient are adjoint, so that A q = -div u(q) is symmetric and
positive under the volumes V, and sum V |u|^2 = <q, A q>, whatever the layers.
"""

import taichi as ti

from msph.fluid.particles.layers import Layers
from msph.fluid.particles.neighbour_list import NeighbourList
from msph.fluid.particles.particles import Attribute, Particles
from msph.taichi_internals import data_oriented

ATTRIBUTES = (
    Attribute("displacement", "m", "by the multipliers that are looked at", 3, carried=False),
)


@data_oriented
class PressureOperator:
    """pair_gradient holds V_j grad W_ij [1/m] of each entry of the neighbour list. Where there are
    no bodies their gradients are 0."""

    def __init__(
        self,
        layers: Layers,
        particles: Particles,
        neighbours: NeighbourList,
        pair_gradient: ti.MatrixField,
    ):
        self.layers, self.particles, self.neighbours = layers, particles, neighbours
        self.pair_gradient = pair_gradient
        self.images = neighbours.images

    @ti.func
    def displacement(self, i, q: ti.template()):
        """u_i = -(q_i g_i + sum V_j q_j grad W_ij) [m]."""
        u = -q[i] * self.particles.gradient[i]
        for s in range(self.neighbours.start[i], self.neighbours.end[i]):
            u -= q[self.images.neighbour(self.neighbours.index[s])] * self.pair_gradient[s]
        return u

    @ti.func
    def wall_displacement(self, i, q: ti.template()):
        """The part of u_i [m] by walls and bodies."""
        u = -q[i] * self.particles.boundary_gradient[i]
        for s in range(self.neighbours.mirrors[i], self.neighbours.end[i]):
            j = self.images.neighbour(self.neighbours.index[s])
            u -= (q[i] + q[j]) * self.pair_gradient[s]
        return u

    @ti.func
    def divergences(self, i, first: ti.template(), second: ti.template()):
        """divergence() of two fields in one pass."""
        a, b, by_body = first[i], second[i], self.particles.boundary_gradient[i]
        found = ti.Vector([a.dot(by_body), b.dot(by_body)])
        for mirrored in ti.static((False, True)):
            begin, end = self.neighbours.span(i, mirrored)
            for s in range(begin, end):
                j, mirror, _ = self.neighbours.read(s, mirrored)
                gradient = self.pair_gradient[s]
                found[0] += (a - mirror * first[j]).dot(gradient)
                found[1] += (b - mirror * second[j]).dot(gradient)
        return found

    @ti.func
    def divergence(self, i, field: ti.template()):
        """sum V_j (u_i - u_j).grad W_ij of a vector field u [u's unit / m]."""
        u = field[i]
        found = u.dot(self.particles.boundary_gradient[i])
        for mirrored in ti.static((False, True)):
            begin, end = self.neighbours.span(i, mirrored)
            for s in range(begin, end):
                j, mirror, _ = self.neighbours.read(s, mirrored)
                found += (u - mirror * field[j]).dot(self.pair_gradient[s])
        return found

    @ti.func
    def apply(self, n, q: ti.template()):
        """Displacements u of all particles by the multipliers q (capacity,) [m^2]; returns
        <q, A q> = sum V |u|^2 [m^5]."""
        product = 0.0
        for i in range(n):
            u = self.displacement(i, q)
            self.particles.displacement[i] = u
            product += self.layers.volume[self.particles.layer[i]] * u.norm_sqr()
        return product

    @ti.func
    def response(self, i, q: ti.template()):
        """A q at particle i (-), after apply() of q."""
        return -self.divergence(i, self.particles.displacement)
