"""Shear relief: removes the shear stress that particle arrangements have and water does not have.

The stress of an inviscid fluid is isotropic. Pairs press on each other along their axes, so
particles under pressure have the virial stress (Irving and Kirkwood 1950)

    S_i = -sum V_j share_ij (p_i + p_j) r_ij (x) grad W_ij,

share_ij = 1/2 for equal particles (virial_pressure.py). Where the flow strains neighbourhoods, the
deviator of S resists, like the friction of a granular medium, most of all in the topmost sheet of
particles and at bodies, and damps low waves and wakes. The deviator's mean over a kernel, the
stress on the scale of the flow,

    T_i = dev(sum V_j W_ij S_j)/sum V_j W_ij,

is taken out of the momentum balance; the differences between particles stay and keep them apart.
The power that is returned is T_i : (strain rate) for every linear flow, also at surfaces, since
gradients are corrected by the inverse of the kernel's moment M_i = -sum V_j r_ij (x) grad W_ij
(Bonet and Lok 1999; docs/method.md, "Shear relief").
"""

import math

import taichi as ti

from msph.fluid.external_forces import ExternalForces
from msph.fluid.particles.particles import Attribute
from msph.fluid.projection.force import Force
from msph.fluid.projection.parameters import ProjectionParameters
from msph.launches import data_oriented, kernel


@data_oriented
class ShearRelief(Force):
    """Force div T/rho0 times the share `shear_relief` (-).

    Pairs exchange V_i V_j (T_i L_i + T_j L_j).grad W_ij, L = M^-1, equal and opposite, so momentum
    is kept for all layers. The torques of the term of i add up to the antisymmetric part of
    T_i L_i M_i = T_i, which is zero, so angular momentum is kept.

    Images in bodies move with the mirrored velocities of their particles, so that faces exert
    forces along their normals only. fitting_step [s]: the longest that motion and pressure allow.
    """

    fitting_step = math.inf

    ATTRIBUTES = (
        Attribute("normal_stress", "Pa", "diagonal of the last step's virial stress", 3),
        Attribute("shear_stress", "Pa", "its yz, xz and xy components", 3),
        Attribute("relief", "Pa", "rows of share T_i L_i, set by Density", 9, carried=False),
    )

    @staticmethod
    def enabled(parameters: ProjectionParameters) -> bool:
        return parameters.shear_relief > 0.0

    def tune(self, parameters: ProjectionParameters) -> None:
        self.share_per_density = parameters.shear_relief / self.layers.rest_density  # [m^3/kg]

    def apply(self, dt: float, external: ExternalForces) -> None:
        """Advances the velocities by dt [s] under div T, with the stresses of the last step, which
        do not fit the positions after steps beyond `fitting_step`."""
        fitting = min(max(2.0 - dt / self.fitting_step, 0.0), 1.0)
        self._accelerate(self.particles.count, fitting * dt * self.share_per_density)

    @kernel
    def _accelerate(self, n: ti.i32, impulse: ti.f32):
        """v_i += impulse sum V_j (T_i L_i + T_j L_j).grad W_ij; impulse: share dt/rho0
        [s m^3/kg]."""
        p = self.particles
        for i in range(n):
            change, own = ti.math.vec3(0.0), ti.math.vec3(0.0)
            for s in range(self.neighbours.start[i], self.neighbours.end[i]):
                g = self.pair_gradient[s]
                own += g
                change += rows_times_vector(p.relief[self.neighbours.index[s]], g)
            m, change = self.layers.mass[p.layer[i]], change + rows_times_vector(p.relief[i], own)
            self.impulses.record_internal(i, m, p.x[i], impulse * change)
            by_walls = ti.math.vec3(0.0)
            for s in range(p.first_image[i], p.image_end[i]):
                by_walls += self._by_image(i, s, m * impulse)
            self.impulses.wall_impulse.add(i, m * impulse * by_walls)
            p.v[i] += impulse * (change + by_walls)

    @ti.func
    def _by_image(self, i, s, impulse):
        """Returns T_i L_i.g - R T_j L_j.back [Pa/m] of image s, whose mirror is R; a body receives
        the opposite, times `impulse` (m share dt/rho0).

        An image has the mirrored velocity of its particle j, so the term of i pushes j by the
        mirrored opposite, and the body by the sum, along its normal.
        """
        j, p, images = self.images.index[s], self.particles, self.images
        found = rows_times_vector(p.relief[i], images.gradient[s])
        found -= images.mirrored(s, rows_times_vector(p.relief[j], images.reaction[s]))
        if ti.static(self.traits.bodies):
            if images.link[s] >= 0:
                self.links.push_at_face(images.link[s], -impulse * found)
        return found


@ti.func
def rows_times_vector(rows, g):
    """Returns the 3 x 3 matrix with these rows, one after the other, times g."""
    return ti.math.vec3(
        rows[0] * g.x + rows[1] * g.y + rows[2] * g.z,
        rows[3] * g.x + rows[4] * g.y + rows[5] * g.z,
        rows[6] * g.x + rows[7] * g.y + rows[8] * g.z,
    )
