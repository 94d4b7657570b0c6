"""Surface tension: a force that shrinks the surface's area, and a cohesion near the surface.

g_i = sum V_j grad W_ij points into the water at its surface and vanishes inside. So the energy
AREA_FACTOR sigma sum V_i sqrt(|g_i|^2 + 1/h_i^2) measures area (total variation, Rudin et al. 1992,
softened where g is noise); its gradient pulls where the surface is curved. This term alone lets
water evaporate, since a lone particle has g = 0 and no area. A pair cohesion near the surface
(after Tartakovsky and Panchenko 2016) prevents this; in all the water it would act like a solid.

Pair forces are equal and opposite for all layers, so momentum is kept. The cohesion is central and
rotation does not change the area, so angular momentum is kept too.
"""

import math

import taichi as ti

from msph.fluid.external_forces import ExternalForces
from msph.fluid.particles import kernels
from msph.fluid.particles.particles import Attribute
from msph.fluid.projection.force import Force
from msph.fluid.projection.parameters import ProjectionParameters
from msph.fluid.small_numbers import MIN_DIVISOR
from msph.launches import data_oriented, kernel

# Share of sigma by cohesion (-): with 0.3 drops of 4 spacings' radius shed particles, from 0.4 on
# some drops oscillate too slowly.
COHESION_SHARE = 0.35
# Factor of both parts with which drops oscillate at Lamb's period (bench/terms.py).
CALIBRATION = 1.45
# With a factor of 2, since only the half of |g| on the water's side of a surface is counted.
AREA_FACTOR = 2.0 * (1.0 - COHESION_SHARE) * CALIBRATION
# Factor of (r/h) (1 - (r/h)^2)^2/h^5, a force per volume^2: sigma is pi/8 times the integral of r^4
# times the force (Fowler 1937), which is 1/60 for a factor of 1.
COHESION_FACTOR = 480.0 / math.pi * COHESION_SHARE * CALIBRATION
# Longest step over sqrt(rho d^3/(2 pi sigma)), the time scale of the shortest capillary wave (-).
CAPILLARY_FACTOR = 0.5


@data_oriented
class SurfaceTension(Force):
    """Force of a surface tension `tension` [N/m]."""

    ATTRIBUTES = (
        Attribute("normal", "-", "into the water at its surface, short inside", 3, carried=False),
    )

    LIMITED_BY = "tension"

    @staticmethod
    def enabled(parameters: ProjectionParameters) -> bool:
        return parameters.tension > 0.0

    def tune(self, parameters: ProjectionParameters) -> None:
        self.tension_per_density = parameters.tension / self.layers.rest_density
        wave = self.layers.finest.volume / (2.0 * math.pi * self.tension_per_density)
        self.longest_step = CAPILLARY_FACTOR * math.sqrt(wave)

    def apply(self, dt: float, external: ExternalForces) -> None:
        n = self.particles.count
        self._find_normals(n)
        self._accelerate(n, dt * self.tension_per_density)

    @kernel
    def _find_normals(self, n: ti.i32):
        """n_i = g_i / sqrt(|g_i|^2 + 1/h_i^2)."""
        for i in range(n):
            g = self.particles.gradient[i]
            soft = 1.0 / self.layers.support[self.particles.layer[i]]
            self.particles.normal[i] = g / ti.sqrt(g.norm_sqr() + soft * soft)

    @kernel
    def _accelerate(self, n: ti.i32, impulse: ti.f32):
        """v_i -= impulse sum V_j (AREA_FACTOR H_ij (n_i - n_j) + COHESION_FACTOR s_ij f e_ij).

        impulse = dt sigma/rho; H: second derivatives of W, W'/r + (W'' - W'/r) e e;
        s_ij = (|n_i| + |n_j|)/2, so that water inside is not compressed.
        """
        for i in range(n):
            x, normal = self.particles.x[i], self.particles.normal[i]
            layer, total = self.particles.layer[i], ti.Vector([0.0, 0.0, 0.0])
            for s in range(self.neighbours.start[i], self.neighbours.end[i]):
                j, g = self.neighbours.index[s], self.pair_gradient[s]
                n_j = self.particles.normal[j]
                total += self._pair_term(g, layer, j, x - self.particles.x[j], normal, n_j)
            by_walls = ti.Vector([0.0, 0.0, 0.0])
            for s in range(self.particles.first_image[i], self.particles.body_image[i]):
                j, g = self.images.index[s], self.images.gradient[s]
                n_j = self.images.mirrored(s, self.particles.normal[j])
                by_walls += self._pair_term(g, layer, j, self.images.arm[s], normal, n_j)
            self.impulses.wall_impulse.add(i, -self.layers.mass[layer] * impulse * by_walls)
            self.particles.v[i] -= impulse * (total + by_walls)

    @ti.func
    def _pair_term(self, g, layer, j, r_ij, n_i, n_j):
        """Returns the term of an entry (j, g) of the sum [1/m^2] for a particle of a layer."""
        other, bend = self.particles.layer[j], n_i - n_j
        per_h, scale = self.layers.per_h[layer, other], self.layers.scale[layer, other]
        r2, volume = r_ij.norm_sqr(), self.layers.volume[other]
        q = ti.min(ti.sqrt(r2) * per_h, 1.0)
        second = scale * per_h**2 * kernels.quartic_shape(q).z
        slope = g.dot(r_ij) / ti.max(r2, MIN_DIVISOR)
        along = (second - slope) / ti.max(r2, MIN_DIVISOR)
        area = AREA_FACTOR * (slope * bend + along * r_ij.dot(bend) * r_ij)
        share = 0.5 * (n_i.norm() + n_j.norm())
        u = 1.0 - q * q
        return area + COHESION_FACTOR * share * volume * per_h**6 * (u * u) * r_ij
