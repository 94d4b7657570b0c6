"""Shear relief: what an arrangement of particles bears beside pressure is given back to the water.

The stress of an inviscid fluid is isotropic. Pairs press on each other along their axes, so
particles under pressure have the virial stress (Irving and Kirkwood 1950)

    S_i = -sum V_j share_ij (p_i + p_j) r_ij (x) grad W_ij,

share_ij = 1/2 among equals (virial_pressure.py). Strain makes neighbourhoods anisotropic, and the
deviator of S then resists it, as the friction of a granular medium does: low waves die. The
deviator's mean over a kernel, the stress of the scale on which water flows,

    T_i = dev(sum V_j W_ij S_j)/sum V_j W_ij,

is taken out of the momentum balance; what differs from particle to particle stays, and keeps them
apart. docs/method.md, "Shear relief", has the measurements.
"""

import math

import taichi as ti

from msph.fluid.external_forces import ExternalForces
from msph.fluid.particles.particles import Attribute
from msph.fluid.projection.discretisation import Discretisation
from msph.fluid.projection.parameters import LEAP, ProjectionParameters
from msph.taichi_internals import data_oriented, kernel

# Deviator over mean stress (-), both of the kernel's mean, up to which it is an arrangement's, and
# from twice of which on it is none of it: a sheet of one particle has .5, surfaces .25, depths .01.
ARRANGED = 0.2
# Relative difference (-) between a particle's pair_spacing and its spacing, with the same fade:
# without it coarse particles on fine ones of a 64th of their mass gain .25 % of the energy in 1 s.
UNLIKE = 0.07
# Least mean stress [Pa] that a deviator is compared with, and least weight (-) of a mean.
LEAST_STRESS, LEAST_WEIGHT = 1e-6, 1e-6


@ti.func
def upto(limit, value):
    """1 up to `limit`, 0 from twice of it on."""
    return ti.math.clamp(2.0 - value / limit, 0.0, 1.0)


@ti.func
def shears(a, b):
    """The yz, xz and xy components of a (x) b + b (x) a."""
    return ti.Vector([a.y * b.z + a.z * b.y, a.x * b.z + a.z * b.x, a.x * b.y + a.y * b.x])


@ti.func
def seen(mirror, shear):
    """Shear components seen in a mirror: two of its signs multiply each."""
    return mirror.x * mirror.y * mirror.z * mirror * shear


@ti.func
def times(normal, shear, g):
    """The symmetric tensor of diagonal `normal` and yz, xz, xy components `shear`, times g."""
    return normal * g + shears(shear, g)


@data_oriented
class ShearRelief:
    """Accelerates the water by div T/rho0, `shear_relief` (-) times.

    Pairs exchange V_i V_j (T_i + T_j).grad W_ij, equal and opposite, so momentum is kept whatever
    the layers. Their torques sum up to the product of T_i and sum V_j r_ij (x) grad W_ij, which is
    symmetric but for the deviator of that, so angular momentum is kept to second order.
    """

    ATTRIBUTES = (
        Attribute("normal_stress", "Pa", "diagonal of the last step's virial stress", 3),
        Attribute("shear_stress", "Pa", "its yz, xz and xy components", 3),
        Attribute("mean_normal_stress", "Pa", "of the mean deviator", 3, carried=False),
        Attribute("mean_shear_stress", "Pa", "of the mean deviator", 3, carried=False),
    )

    @staticmethod
    def wanted(parameters: ProjectionParameters) -> bool:
        return parameters.shear_relief > 0.0

    def __init__(self, shared: Discretisation):
        self.layers, self.particles = shared.layers, shared.particles
        self.neighbours, self.images = shared.neighbours, shared.neighbours.images
        self.density, self.impulses = shared.density, shared.impulses
        self.constants = shared.constants
        self.longest_step = math.inf

    def tune(self, parameters: ProjectionParameters) -> None:
        """Takes over the share, and the steps in which forces by pressures are stable."""
        self.share = parameters.shear_relief / self.layers.rest_density
        self.cfl, self.pressure_cfl = parameters.cfl, parameters.pressure_cfl

    def apply(self, dt: float, external: ExternalForces) -> None:
        """Velocities after dt [s] without the deviator, by the stresses of the last step."""
        n = self.particles.count
        self._find_mean(n, dt / self.pressure_cfl, dt / self.cfl)
        self._accelerate(n, self.share * dt)

    @kernel
    def _find_mean(self, n: ti.i32, swing: ti.f32, way: ti.f32):
        """T_i with the bell (1 - q^2)^4 as W, i itself included, over those that are known; swing,
        way [s]: the time step over pressure_cfl and over cfl. In steps beyond their bounds the
        stress is no more that of where particles are, and none of it is given back."""
        p = self.particles
        for i in range(n):
            x, layer = p.x[i], p.layer[i]
            total = self.known(i) * self.layers.own_bell[layer]
            normal, shear = total * p.normal_stress[i], total * p.shear_stress[i]
            for mirrored in ti.static((False, True)):
                begin, end = self.neighbours.span(i, mirrored)
                for s in range(begin, end):
                    j, mirror, wall = self.neighbours.read(s, mirrored)
                    r = self.images.offset(x, p.x[j], mirror, wall)
                    per_h = self.layers.per_h[layer, p.layer[j]]
                    u = ti.max(1.0 - r.norm_sqr() * per_h**2, 0.0)
                    weight = self.known(j) * self.layers.bell_scale[layer, p.layer[j]]
                    weight *= (u * u) * (u * u)
                    normal += weight * p.normal_stress[j]
                    shear += weight * seen(mirror, p.shear_stress[j])
                    total += weight
            pressure = normal.sum() / 3.0
            normal -= pressure
            size = ti.sqrt(normal.norm_sqr() + 2.0 * shear.norm_sqr())
            share = self.borne(i) * upto(ARRANGED, size / ti.max(pressure, LEAST_STRESS))
            per_total = 1.0 / ti.max(total, LEAST_WEIGHT)
            wave = ti.sqrt(ti.max(per_total * pressure, 0.0) / self.constants.rest_density[None])
            share *= per_total * upto(1.0, swing * wave / p.pair_spacing[i])
            share *= upto(LEAP, way * p.v[i].norm() / self.layers.spacing[layer])
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
                    shear = own_shear + seen(mirror, p.mean_shear_stress[j])
                    change += times(normal, shear, self.density.pair_gradient[s])
                change *= impulse
                v += change
                if ti.static(mirrored):
                    self.impulses.wall_impulse[None] += m * change
                else:
                    self.impulses.record_internal(m, p.x[i], change)
            if p.boundary_gradient[i].norm_sqr() > 0.0:
                # Twice, for sum V_j grad W_ij + b_i = 0: an even stress pushes nowhere.
                body = 2.0 * impulse * times(own, own_shear, p.boundary_gradient[i])
                v += body
                self.impulses.body_impulse[None] += m * body
                self.impulses.wall_impulse[None] += m * body
            p.v[i] = v

    @ti.func
    def borne(self, i):
        """Share (-) of the deviator round particle i that is the friction of an arrangement: none
        among particles of other sizes."""
        own = self.layers.spacing[self.particles.layer[i]]
        return upto(UNLIKE, ti.abs(self.particles.pair_spacing[i] / own - 1.0))

    @ti.func
    def known(self, i):
        """1, or 0 where a body bears a part of the stress of particle i."""
        return ti.select(self.particles.boundary_gradient[i].norm_sqr() == 0.0, 1.0, 0.0)
