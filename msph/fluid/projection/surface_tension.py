"""Surface tension: forces that shrink the surface's area, and a cohesion that holds it together.

With g_i = sum V_j grad W_ij, which points into the water at its surface and vanishes within, the
energy AREA sigma sum V_i sqrt(|g_i|^2 + 1/h_i^2) measures area (total variation, Rudin, Osher and
Fatemi 1992, softened where g is mere noise); its gradient pulls where the surface is curved. Alone
it lets water evaporate, since a lone particle has g = 0 and so no area. A pair cohesion (after
Tartakovsky and Panchenko 2016) near the surface prevents that. Cohesion alone, in all the water,
sets like a glass.

Pair forces are equal and opposite whatever the layers, so momentum is kept; cohesion is central and
the area does not change as water turns, so angular momentum is kept too.
"""

import math

import taichi as ti

from msph.fluid.external_forces import ExternalForces
from msph.fluid.particles import kernels
from msph.fluid.particles.particles import Attribute
from msph.fluid.projection.discretisation import Discretisation
from msph.fluid.projection.parameters import ProjectionParameters
from msph.taichi_internals import data_oriented, kernel

# Share of sigma that is cohesion's: with .3 drops of 4 spacings' radius shed particles, from .4 on
# some drops swing too slowly.
SHARE = 0.35
# Factor of both parts by which drops swing with Lamb's period (bench/terms.py).
CALIBRATION = 1.45
# The energy is counted on the fluid's side of a surface alone, where half of |g| lies.
AREA = 2.0 * (1.0 - SHARE) * CALIBRATION
# Force (r/h) (1 - (r/h)^2)^2/h^5 per volume^2: sigma is pi/8 times the integral of r^4 times it
# (Fowler 1937), which is 1/60.
COHESION = 480.0 / math.pi * SHARE * CALIBRATION
# Time step in units of sqrt(rho d^3/(2 pi sigma)), that of the shortest capillary wave.
CAPILLARY = 0.5
# Keeps divisions by what may vanish finite [m^2].
TINY = 1e-30


@data_oriented
class SurfaceTension:
    """Pulls at the surface with a tension of `tension` [N/m]; reads Density's gradients."""

    ATTRIBUTES = (
        Attribute("normal", "-", "into the water at its surface, below 1 within", 3, carried=False),
    )

    @staticmethod
    def wanted(parameters: ProjectionParameters) -> bool:
        return parameters.tension > 0.0

    def __init__(self, shared: Discretisation):
        self.layers, self.particles = shared.layers, shared.particles
        self.density, self.neighbours = shared.density, shared.neighbours
        self.images = shared.neighbours.images

    def tune(self, parameters: ProjectionParameters) -> None:
        self.ratio = parameters.tension / self.layers.rest_density
        wave = self.layers.finest.volume / (2.0 * math.pi * self.ratio)
        self.longest_step = CAPILLARY * math.sqrt(wave)

    def apply(self, dt: float, external: ExternalForces) -> None:
        """Velocities after dt [s] of surface tension."""
        n = self.particles.count
        self.find_normals(n)
        self.pull(n, dt * self.ratio)

    @kernel
    def find_normals(self, n: ti.i32):
        """n_i = g_i / sqrt(|g_i|^2 + 1/h_i^2)."""
        for i in range(n):
            g = self.particles.gradient[i]
            soft = 1.0 / self.layers.support[self.particles.layer[i]]
            self.particles.normal[i] = g / ti.sqrt(g.norm_sqr() + soft * soft)

    @kernel
    def pull(self, n: ti.i32, impulse: ti.f32):
        """v_i -= dt sigma/rho sum V_j (AREA H_ij (n_i - n_j) + COHESION s_ij f(r_ij) e_ij).

        H: second derivatives of W, W'/r + (W'' - W'/r) e e; s_ij = (|n_i| + |n_j|)/2, so that
        water within is not squeezed.
        """
        for i in range(n):
            x, normal = self.particles.x[i], self.particles.normal[i]
            layer, total = self.particles.layer[i], ti.Vector([0.0, 0.0, 0.0])
            for mirrored in ti.static((False, True)):
                begin, end = self.neighbours.span(i, mirrored)
                for s in range(begin, end):
                    j, mirror, wall = self.neighbours.read(s, mirrored)
                    r_ij = self.images.offset(x, self.particles.x[j], mirror, wall)
                    seen = mirror * self.particles.normal[j]
                    total += self.pair(s, layer, j, r_ij, normal, seen)
            self.particles.v[i] -= impulse * total

    @ti.func
    def pair(self, s, layer, j, r_ij, n_i, n_j):
        """Neighbour j's part of the sum [1/m^2] of a particle of a layer."""
        other, bend = self.particles.layer[j], n_i - n_j
        per_h, scale = self.layers.per_h[layer, other], self.layers.scale[layer, other]
        r2, volume = r_ij.norm_sqr(), self.layers.volume[other]
        q = ti.min(ti.sqrt(r2) * per_h, 1.0)
        second = scale * per_h**2 * kernels.quartic_shape(q).z
        slope = self.density.pair_gradient[s].dot(r_ij) / ti.max(r2, TINY)
        along = (second - slope) / ti.max(r2, TINY)
        area = AREA * (slope * bend + along * r_ij.dot(bend) * r_ij)
        share = 0.5 * (n_i.norm() + n_j.norm())
        u = 1.0 - q * q
        return area + COHESION * share * volume * per_h**6 * (u * u) * r_ij
