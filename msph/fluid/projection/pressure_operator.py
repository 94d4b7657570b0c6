"""Discrete gradient of pressure, and the divergence that is its adjoint.

Multipliers q [m^2] displace particles by u_i = -sum V_j (q_i + q_j) grad W_ij [m], which changes
relative densities by sum V_j (u_i - u_j).grad W_ij. Sums run over neighbours and mirror images, in
walls and in bodies. Floating bodies are displaced as well (body_links.py). Gradient and
divergence are adjoint: A q = -div u(q) is symmetric and positive semi-definite under the volumes V,
and <q, A q> is sum V |u|^2 and the same sum over the bodies, for all layers.
"""

import taichi as ti

from msph.fluid.particles.particles import Attribute
from msph.fluid.parts import Parts
from msph.launches import data_oriented

ATTRIBUTES = (
    Attribute("displacement", "m", "by the multipliers of the last apply()", 3, carried=False),
)


@data_oriented
class PressureOperator:
    """Operator A; pair_gradient is V_j grad W_ij [1/m] of each entry of the neighbour list."""

    def __init__(self, parts: Parts, pair_gradient: ti.MatrixField):
        self.layers, self.particles = parts.layers, parts.particles
        self.links, self.body_images = parts.links, parts.body_images
        self.neighbours, self.images = parts.neighbours, parts.neighbours.images
        self.pair_gradient = pair_gradient

    @ti.func
    def displacement(self, i, q: ti.template()):
        """Returns u_i = -(q_i g_i + sum V_j q_j grad W_ij) [m], 0 where an opening prescribes the
        velocity."""
        u = -q[i] * self.particles.gradient[i]
        for s in range(self.neighbours.start[i], self.neighbours.end[i]):
            u -= q[self.images.neighbour(self.neighbours.index[s])] * self.pair_gradient[s]
        for s in range(self.particles.first_image[i], self.particles.image_end[i]):
            j = self.images.neighbour(self.body_images.index[s])
            u -= q[j] * self.body_images.gradient[s]
        return ti.select(self.particles.prescribed[i] > 0, 0.0, 1.0) * u

    @ti.func
    def wall_displacement(self, i, q: ti.template()):
        """Returns the part of u_i [m] that walls and bodies cause."""
        u = -q[i] * self.particles.boundary_gradient[i]
        for s in range(self.neighbours.mirrors[i], self.neighbours.end[i]):
            j = self.images.neighbour(self.neighbours.index[s])
            u -= (q[i] + q[j]) * self.pair_gradient[s]
        for s in range(self.particles.first_image[i], self.particles.image_end[i]):
            j = self.images.neighbour(self.body_images.index[s])
            u -= q[j] * self.body_images.gradient[s]
        return u

    @ti.func
    def divergences(self, i, first: ti.template(), second: ti.template()):
        """Returns divergence() of two fields, computed in one pass."""
        a, b, by_body = first[i], second[i], self.particles.boundary_gradient[i]
        found = ti.Vector([a.dot(by_body), b.dot(by_body)])
        for mirrored in ti.static((False, True)):
            begin, end = self.neighbours.span(i, mirrored)
            for s in range(begin, end):
                j, mirror, _ = self.neighbours.read(s, mirrored)
                gradient = self.pair_gradient[s]
                found[0] += (a - mirror * first[j]).dot(gradient)
                found[1] += (b - mirror * second[j]).dot(gradient)
        for s in range(self.particles.first_image[i], self.particles.image_end[i]):
            j, back = self.images.neighbour(self.body_images.index[s]), self.body_images.reaction[s]
            found += ti.Vector([first[j].dot(back), second[j].dot(back)])
        return found

    @ti.func
    def divergence(self, i, field: ti.template()):
        """Returns sum V_j (u_i - u_j).grad W_ij of a vector field u [u's unit / m]."""
        u = field[i]
        found = u.dot(self.particles.boundary_gradient[i])
        for mirrored in ti.static((False, True)):
            begin, end = self.neighbours.span(i, mirrored)
            for s in range(begin, end):
                j, mirror, _ = self.neighbours.read(s, mirrored)
                found += (u - mirror * field[j]).dot(self.pair_gradient[s])
        for s in range(self.particles.first_image[i], self.particles.image_end[i]):
            j = self.images.neighbour(self.body_images.index[s])
            found += field[j].dot(self.body_images.reaction[s])
        return found

    @ti.func
    def apply(self, n, q: ti.template()):
        """Stores the displacements u by the multipliers q (capacity,) [m^2], and those of floating
        bodies; returns <q, A q> [m^5]."""
        product = 0.0
        for i in range(n):
            u = self.displacement(i, q)
            self.particles.displacement[i], self.particles.body_approach[i] = u, 0.0
            product += self.layers.volume[self.particles.layer[i]] * u.norm_sqr()
        return product + self.links.displace(q)

    @ti.func
    def response(self, i, q: ti.template()):
        """Returns A q at particle i (-), after apply() of q."""
        closing = self.divergence(i, self.particles.displacement)
        return -closing - self.particles.body_approach[i]
