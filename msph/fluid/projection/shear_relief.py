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
from msph.fluid.projection.density import fade_out
from msph.fluid.projection.force import Force
from msph.fluid.projection.parameters import ProjectionParameters
from msph.fluid.small_numbers import MIN_WEIGHT
from msph.launches import data_oriented, heavy_kernel, kernel

# Ratio (-) of deviator to pressure above which the relief fades out, to none at twice this. It is
# 0.01 in the depth, 0.07 at surfaces, 0.5 in a sheet of one particle, which gains energy with 0.2.
MAX_ANISOTROPY = 0.15
# Relative difference (-) of pair_spacing from spacing above which the relief fades out likewise:
# otherwise coarse particles on fine ones of a 64th of their mass gain 0.25 % of the energy in 1 s.
MAX_SPACING_DIFFERENCE = 0.07
# Smallest pressure [Pa] that a deviator is compared with.
MIN_STRESS = 1e-6
# Determinant of the moment M (-) below which there is no relief; from twice this on it is full. It
# is 1 in the depth and 0.4 in the topmost sheet; with 0.05, steps of five times the limit blow up.
LEAST_DETERMINANT = 0.15


@ti.func
def mirrored_shear(mirror, shear):
    """Returns the shear components of a mirror image: each times two signs of `mirror`."""
    return mirror.x * mirror.y * mirror.z * mirror * shear


@data_oriented
class ShearRelief(Force):
    """Force div T/rho0 times the share `shear_relief` (-).

    Pairs exchange V_i V_j (T_i L_i + T_j L_j).grad W_ij, L = M^-1, equal and opposite, so momentum
    is kept for all layers. The torques of the term of i add up to the antisymmetric part of
    T_i L_i M_i = T_i, which is zero, so angular momentum is kept.

    Images in bodies move with the mirrored velocities of their particles, so that faces exert
    forces along their normals only. longest [s]: the longest step that motion and pressure allow.
    """

    longest = math.inf

    ATTRIBUTES = (
        Attribute("normal_stress", "Pa", "diagonal of the last step's virial stress", 3),
        Attribute("shear_stress", "Pa", "its yz, xz and xy components", 3),
        Attribute("relief", "Pa", "rows of share T_i L_i", 9, carried=False),
    )

    @staticmethod
    def enabled(parameters: ProjectionParameters) -> bool:
        return parameters.shear_relief > 0.0

    def tune(self, parameters: ProjectionParameters) -> None:
        self.share = parameters.shear_relief / self.layers.rest_density

    def apply(self, dt: float, external: ExternalForces) -> None:
        """Advances the velocities by dt [s] under div T, with the stresses of the last step, which
        do not fit the positions after steps beyond `longest`."""
        n = self.particles.count
        impulse = self.share * dt * min(max(2.0 - dt / self.longest, 0.0), 1.0)
        self._find(n)
        self._accelerate(n, impulse)
        if self.boundary.count:
            self.links.record_pushes()

    @heavy_kernel
    def _find(self, n: ti.i32):
        """Computes T_i L_i with the bell (1 - q^2)^4 as W, i included."""
        p = self.particles
        for i in range(n):
            x, layer = p.x[i], p.layer[i]
            total = self.layers.own_bell[layer]
            normal, shear = total * p.normal_stress[i], total * p.shear_stress[i]
            stretch, turn = ti.math.vec3(0.0), ti.math.vec3(0.0)  # M: diagonal; yz, xz, xy
            for mirrored in ti.static((False, True)):
                begin, end = self.neighbours.span(i, mirrored)
                for s in range(begin, end):
                    j, mirror, wall = self.neighbours.read(s, mirrored)
                    r = self.images.offset(x, p.x[j], mirror, wall)
                    g = self.density.pair_gradient[s]
                    per_h = self.layers.per_h[layer, p.layer[j]]
                    u = ti.max(1.0 - r.norm_sqr() * per_h**2, 0.0)
                    weight = self.layers.bell_scale[layer, p.layer[j]] * (u * u) * (u * u)
                    normal += weight * p.normal_stress[j]
                    shear += weight * mirrored_shear(mirror, p.shear_stress[j])
                    total += weight
                    stretch -= r * g
                    turn -= ti.math.vec3(r.y * g.z, r.x * g.z, r.x * g.y)
            for link in range(p.first_link[i], p.first_link[i] + p.links[i]):
                for s in range(self.body_images.first[link], self.body_images.end[link]):
                    r, g = self.body_images.arm(link, s)[0], self.body_images.gradient[s]
                    j = self.body_images.particle(s)
                    per_h = self.layers.per_h[layer, p.layer[j]]
                    u = ti.max(1.0 - r.norm_sqr() * per_h**2, 0.0)
                    weight = self.layers.bell_scale[layer, p.layer[j]] * (u * u) * (u * u)
                    weight *= self.body_images.factor(link, self.body_images.partner[s])
                    mirror = self.body_images.reflection(link, s)
                    stress = mirror @ symmetric(p.normal_stress[j], p.shear_stress[j])
                    stress = weight * stress @ mirror.transpose()
                    normal += ti.math.vec3(stress[0, 0], stress[1, 1], stress[2, 2])
                    shear += ti.math.vec3(stress[1, 2], stress[0, 2], stress[0, 1])
                    total += weight
                    stretch -= r * g
                    turn -= ti.math.vec3(r.y * g.z, r.x * g.z, r.x * g.y)
            pressure = normal.sum() / 3.0
            normal -= pressure
            size = ti.sqrt(normal.norm_sqr() + 2.0 * shear.norm_sqr())
            difference = ti.abs(p.pair_spacing[i] / self.layers.spacing[layer] - 1.0)
            share = fade_out(MAX_SPACING_DIFFERENCE, difference)
            share *= fade_out(MAX_ANISOTROPY, size / ti.max(pressure, MIN_STRESS))
            share /= ti.max(total, MIN_WEIGHT)
            moment = symmetric(stretch, turn)
            determinant = moment.determinant()
            share *= ti.math.clamp(determinant / LEAST_DETERMINANT - 1.0, 0.0, 1.0)
            p.relief[i] = ti.Vector([0.0] * 9)
            if share > 0.0:
                corrected = share * symmetric(normal, shear) @ moment.inverse()
                for row, column in ti.static(ti.ndrange(3, 3)):
                    p.relief[i][3 * row + column] = corrected[row, column]

    @kernel
    def _accelerate(self, n: ti.i32, impulse: ti.f32):
        """v_i += impulse sum V_j (T_i L_i + T_j L_j).grad W_ij; impulse: share dt/rho0
        [s m^3/kg]."""
        p = self.particles
        for i in range(n):
            m, v = self.layers.mass[p.layer[i]], p.v[i]
            for mirrored in ti.static((False, True)):
                change, own = ti.math.vec3(0.0), ti.math.vec3(0.0)
                begin, end = self.neighbours.span(i, mirrored)
                for s in range(begin, end):
                    j, mirror, _ = self.neighbours.read(s, mirrored)
                    g = self.density.pair_gradient[s]
                    own += g
                    change += mirror * rows_times_vector(p.relief[j], mirror * g)
                change = impulse * (change + rows_times_vector(p.relief[i], own))
                v += change
                if ti.static(mirrored):
                    self.impulses.wall_impulse.add(i, m * change)
                else:
                    self.impulses.record_internal(i, m, p.x[i], change)
            for link in range(p.first_link[i], p.first_link[i] + p.links[i]):
                change = self._by_body(i, link, impulse)
                v += change
                self.impulses.wall_impulse.add(i, m * change)
            p.v[i] = v

    @ti.func
    def _by_body(self, i, link, impulse):
        """Returns the change of the velocity [m/s] of particle i by the images of a link; stores
        the opposite impulse on the body for record_pushes().

        An image has the mirrored velocity of its particle j, so the term of i pushes j by the
        mirrored opposite, and the body by the sum, along its normal.
        """
        images, p, change = self.body_images, self.particles, ti.math.vec3(0.0)
        for s in range(images.first[link], images.end[link]):
            j, back = images.particle(s), images.reaction[s]
            change += rows_times_vector(p.relief[i], images.gradient[s])
            change -= images.reflection(link, s) @ rows_times_vector(p.relief[j], back)
        change *= impulse
        self.links.push_at_face(link, -self.layers.mass[p.layer[i]] * change)
        return change


@ti.func
def symmetric(diagonal, others):
    """Returns the symmetric matrix of a diagonal and its yz, xz and xy components."""
    return ti.Matrix(
        [
            [diagonal.x, others.z, others.y],
            [others.z, diagonal.y, others.x],
            [others.y, others.x, diagonal.z],
        ]
    )


@ti.func
def rows_times_vector(rows, g):
    """Returns the 3 x 3 matrix with these rows, one after the other, times g."""
    return ti.math.vec3(
        rows[0] * g.x + rows[1] * g.y + rows[2] * g.z,
        rows[3] * g.x + rows[4] * g.y + rows[5] * g.z,
        rows[6] * g.x + rows[7] * g.y + rows[8] * g.z,
    )
