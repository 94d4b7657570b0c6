"""Discrete gradient of pressure, and the divergence that is its adjoint.

Multipliers q [m^2] displace particles by u_i = -sum (q_i + q_j) g [m], which changes relative
densities by sum u_i.g + u_j.back. Sums run over entries (j, g, back): neighbours, with g =
V_j grad W_ij and back = -g, and images in walls and bodies (images.py). Floating bodies are
displaced as well (body_links.py). Gradient and divergence are adjoint: A q = -div u(q) is symmetric
and positive semi-definite under the volumes V, and <q, A q> is sum V |u|^2 and the same sum over
the bodies, for all layers.
"""

import taichi as ti

from msph.fluid.part import Part
from msph.fluid.particles.particles import Attribute
from msph.launches import data_oriented

ATTRIBUTES = (
    Attribute("displacement", "m", "by the multipliers of the last apply()", 3, carried=False),
)


@data_oriented
class PressureOperator(Part):
    """Operator A; pair_gradient is g [1/m] of each entry of the neighbour list, and
    particles.gradient the sum of g over all entries."""

    pair_gradient: ti.MatrixField

    @ti.func
    def displacement(self, i, q: ti.template()):
        """Returns u_i [m], 0 where an opening prescribes the velocity."""
        u = -q[i] * self.particles.gradient[i]
        for s in range(self.neighbours.start[i], self.neighbours.end[i]):
            u -= q[self.neighbours.index[s]] * self.pair_gradient[s]
        for s in range(self.particles.first_image[i], self.particles.image_end[i]):
            u -= q[self.images.index[s]] * self.images.gradient[s]
        return ti.select(self.particles.prescribed[i] > 0, 0.0, 1.0) * u

    @ti.func
    def wall_displacement(self, i, q: ti.template()):
        """Returns the part of u_i [m] that walls and bodies cause."""
        u, own = ti.Vector([0.0, 0.0, 0.0]), q[i]
        for s in range(self.particles.first_image[i], self.particles.image_end[i]):
            u -= (own + q[self.images.index[s]]) * self.images.gradient[s]
        return ti.select(self.particles.prescribed[i] > 0, 0.0, 1.0) * u

    @ti.func
    def divergence(self, i, field: ti.template()):
        """Returns sum u_i.g + u_j.back of a vector field u [u's unit / m]."""
        return self.divergences(i, (field,))[0]

    @ti.func
    def divergences(self, i, fields: ti.template()):
        """Returns divergence() of several fields, computed in one pass."""
        found = ti.Vector([u[i].dot(self.particles.gradient[i]) for u in ti.static(fields)])
        for s in range(self.neighbours.start[i], self.neighbours.end[i]):
            j, g = self.neighbours.index[s], self.pair_gradient[s]
            found -= ti.Vector([u[j].dot(g) for u in ti.static(fields)])
        for s in range(self.particles.first_image[i], self.particles.image_end[i]):
            j, back = self.images.index[s], self.images.reaction[s]
            found += ti.Vector([u[j].dot(back) for u in ti.static(fields)])
        return found

    @ti.func
    def apply(self, n, q: ti.template()):
        """Stores the displacements u by the multipliers q (capacity,) [m^2], and those of floating
        bodies; returns <q, A q> [m^5]."""
        product = 0.0
        for i in range(n):
            u = self.displacement(i, q)
            self.particles.displacement[i] = u
            product += self.layers.volume[self.particles.layer[i]] * u.norm_sqr()
        if ti.static(self.traits.bodies):
            product += self.links.displace(q)
        return product

    @ti.func
    def response(self, i, q: ti.template()):
        """Returns A q at particle i (-), after apply() of q."""
        found = -self.divergence(i, self.particles.displacement)
        if ti.static(self.traits.bodies):
            found += self.links.retreat(i)
        return found
