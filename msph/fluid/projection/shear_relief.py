"""Shear relief: removes the shear stress that arrangements of particles have and water has not.

The stress of an inviscid fluid is isotropic. Pairs press on each other along their axes, so
particles under pressure have the virial stress (Irving and Kirkwood 1950)

    S_i = -sum V_j share_ij (p_i + p_j) r_ij (x) grad W_ij,

share_ij = 1/2 for equal particles (virial_pressure.py). Strain makes neighbourhoods anisotropic,
and the deviator of S then resists it, like the friction of a granular medium: low waves die. The
deviator's mean over a kernel, the stress on the scale of the flow,

    T_i = dev(sum V_j W_ij S_j)/sum V_j W_ij,

is taken out of the momentum balance; the differences between particles stay and keep them apart
(docs/method.md, "Shear relief").
"""

import taichi as ti

from msph.fluid.external_forces import ExternalForces
from msph.fluid.particles.particles import Attribute
from msph.fluid.projection.force import Force
from msph.fluid.projection.parameters import MOTION_FACTOR, ProjectionParameters
from msph.fluid.small_numbers import MIN_WEIGHT
from msph.taichi_internals import data_oriented, kernel

# Ratio (-) of deviator to pressure above which the relief fades out, to none at twice this: in the
# depth it is 0.01, at surfaces 0.25, in a sheet of one particle 0.5.
MAX_ANISOTROPY = 0.2
# The same for the relative difference (-) of a particle's pair_spacing from its spacing: without
# it coarse particles on fine ones of a 64th of their mass gain 0.25 % of the energy in 1 s.
MAX_SPACING_DIFFERENCE = 0.07
# Smallest pressure [Pa] that a deviator is compared with.
MIN_STRESS = 1e-6


@ti.func
def fade_out(limit, value):
    """Returns 1 for values up to `limit`, falling linearly to 0 at twice the limit."""
    return ti.math.clamp(2.0 - value / limit, 0.0, 1.0)


@ti.func
def mirrored_shear(mirror, shear):
    """Returns the shear components of a mirror image: each changes by two signs of `mirror`."""
    return mirror.x * mirror.y * mirror.z * mirror * shear


@ti.func
def tensor_times_vector(normal, shear, g):
    """Returns the symmetric tensor of diagonal `normal` and yz, xz, xy parts `shear`, times g."""
    x = shear.y * g.z + shear.z * g.y
    y = shear.x * g.z + shear.z * g.x
    z = shear.x * g.y + shear.y * g.x
    return normal * g + ti.Vector([x, y, z])


@data_oriented
class ShearRelief(Force):
    """Force div T/rho0 times the share `shear_relief` (-).

    Pairs exchange V_i V_j (T_i + T_j).grad W_ij, equal and opposite, so momentum is kept for all
    layers. Angular momentum is kept to second order: the torques add up to T_i times
    sum V_j r_ij (x) grad W_ij, which is symmetric except for its own deviator.
    """

    ATTRIBUTES = (
        Attribute("normal_stress", "Pa", "diagonal of the last step's virial stress", 3),
        Attribute("shear_stress", "Pa", "its yz, xz and xy components", 3),
        Attribute("mean_normal_stress", "Pa", "diagonal of the mean deviator", 3, carried=False),
        Attribute("mean_shear_stress", "Pa", "its yz, xz and xy components", 3, carried=False),
    )

    @staticmethod
    def enabled(parameters: ProjectionParameters) -> bool:
        return parameters.shear_relief > 0.0

    def tune(self, parameters: ProjectionParameters) -> None:
        self.share = parameters.shear_relief / self.layers.rest_density
        self.cfl, self.pressure_cfl = parameters.cfl, parameters.pressure_cfl

    def apply(self, dt: float, external: ExternalForces) -> None:
        """Advances the velocities by dt [s] under div T, with the stresses of the last step."""
        n = self.particles.count
        self._find_mean(n, dt / self.pressure_cfl, dt / self.cfl)
        self._accelerate(n, self.share * dt)
        if self.boundary.count:
            self._push_bodies(self.share * dt)

    @kernel
    def _find_mean(self, n: ti.i32, pressure_time: ti.f32, motion_time: ti.f32):
        """Computes T_i with the bell (1 - q^2)^4 as W, i included, over particles free of bodies.

        pressure_time, motion_time [s]: the time step over pressure_cfl and over cfl. T fades out in
        steps beyond these bounds, in which the last step's stress no longer fits the positions.
        """
        p = self.particles
        for i in range(n):
            x, layer = p.x[i], p.layer[i]
            total = self._free_of_bodies(i) * self.layers.own_bell[layer]
            normal, shear = total * p.normal_stress[i], total * p.shear_stress[i]
            for mirrored in ti.static((False, True)):
                begin, end = self.neighbours.span(i, mirrored)
                for s in range(begin, end):
                    j, mirror, wall = self.neighbours.read(s, mirrored)
                    r = self.images.offset(x, p.x[j], mirror, wall)
                    per_h = self.layers.per_h[layer, p.layer[j]]
                    u = ti.max(1.0 - r.norm_sqr() * per_h**2, 0.0)
                    weight = self._free_of_bodies(j) * self.layers.bell_scale[layer, p.layer[j]]
                    weight *= (u * u) * (u * u)
                    normal += weight * p.normal_stress[j]
                    shear += weight * mirrored_shear(mirror, p.shear_stress[j])
                    total += weight
            pressure = normal.sum() / 3.0
            normal -= pressure
            size = ti.sqrt(normal.norm_sqr() + 2.0 * shear.norm_sqr())
            difference = ti.abs(p.pair_spacing[i] / self.layers.spacing[layer] - 1.0)
            share = fade_out(MAX_SPACING_DIFFERENCE, difference)
            share *= fade_out(MAX_ANISOTROPY, size / ti.max(pressure, MIN_STRESS))
            per_total = 1.0 / ti.max(total, MIN_WEIGHT)
            wave = ti.sqrt(ti.max(per_total * pressure, 0.0) / self.constants.rest_density[None])
            share *= per_total * fade_out(1.0, pressure_time * wave / p.pair_spacing[i])
            motion = motion_time * p.v[i].norm() / self.layers.spacing[layer]
            share *= fade_out(MOTION_FACTOR, motion)
            p.mean_normal_stress[i], p.mean_shear_stress[i] = share * normal, share * shear

    @kernel
    def _accelerate(self, n: ti.i32, impulse: ti.f32):
        """v_i += impulse sum V_j (T_i + T_j).grad W_ij; impulse: share dt/rho0 [s m^3/kg]."""
        p = self.particles
        for i in range(n):
            m, v = self.layers.mass[p.layer[i]], p.v[i]
            own, own_shear = p.mean_normal_stress[i], p.mean_shear_stress[i]
            for mirrored in ti.static((False, True)):
                change = ti.Vector([0.0, 0.0, 0.0])
                begin, end = self.neighbours.span(i, mirrored)
                for s in range(begin, end):
                    j, mirror, _ = self.neighbours.read(s, mirrored)
                    normal = own + p.mean_normal_stress[j]
                    shear = own_shear + mirrored_shear(mirror, p.mean_shear_stress[j])
                    change += tensor_times_vector(normal, shear, self.density.pair_gradient[s])
                change *= impulse
                v += change
                if ti.static(mirrored):
                    self.impulses.wall_impulse[None] += m * change
                else:
                    self.impulses.record_internal(m, p.x[i], change)
            if p.boundary_gradient[i].norm_sqr() > 0.0:
                # Twice, since sum V_j grad W_ij + b_i = 0: a uniform stress exerts no force.
                b = p.boundary_gradient[i]
                body = 2.0 * impulse * tensor_times_vector(own, own_shear, b)
                v += body
                self.impulses.wall_impulse[None] += m * body
            p.v[i] = v

    @kernel
    def _push_bodies(self, impulse: ti.f32):
        """Records the opposite impulses on bodies; impulse as in _accelerate()."""
        p = self.particles
        for link in range(self.links.found[None]):
            i = self.links.particle[link]
            mirror, b, arm = self.links.image(link)
            shear = mirrored_shear(mirror, p.mean_shear_stress[i])
            push = tensor_times_vector(p.mean_normal_stress[i], shear, self.links.gradient[link])
            m = self.layers.mass[p.layer[i]]
            self.impulses.push_body(b, -2.0 * impulse * m * push, arm)

    @ti.func
    def _free_of_bodies(self, i):
        """Returns 1, or 0 where a body carries a part of particle i's stress."""
        return ti.select(self.particles.boundary_gradient[i].norm_sqr() == 0.0, 1.0, 0.0)
