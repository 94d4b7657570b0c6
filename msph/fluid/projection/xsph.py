"""XSPH: smoothing of velocities towards those of the neighbours (Monaghan 1989, eq. 2.6, applied
to velocities as in Schechter and Bridson 2012).

It damps motion shorter than the kernel and costs one pass. It is no viscosity: its effect depends
on time step and particle size, about as nu = xsph h^2/(30 dt).
"""

import taichi as ti

from msph.fluid.external_forces import ExternalForces
from msph.fluid.particles import kernels
from msph.fluid.projection.force import Force
from msph.fluid.projection.parameters import ProjectionParameters
from msph.launches import data_oriented, kernel


@data_oriented
class Xsph(Force):
    """Force that moves velocities towards the neighbours' mean by the share `xsph` (-) per step.

    Pair exchanges V_i V_j W_ij are equal and opposite, so momentum is kept for all layers; they are
    not central, so angular momentum is not kept.
    """

    @staticmethod
    def enabled(parameters: ProjectionParameters) -> bool:
        return parameters.xsph > 0.0

    def tune(self, parameters: ProjectionParameters) -> None:
        self.strength = parameters.xsph

    def apply(self, dt: float, external: ExternalForces) -> None:
        """Smooths the velocities by the same share for every dt."""
        self._smooth(self.particles.count, self.strength)

    @kernel
    def _smooth(self, n: ti.i32, strength: ti.f32):
        """v_i += strength sum V_j (v_j - v_i) W_ij."""
        for i in range(n):
            x, v = self.particles.x[i], self.particles.v[i]
            layer, total = self.particles.layer[i], ti.Vector([0.0, 0.0, 0.0])
            for mirrored in ti.static((False, True)):
                begin, end = self.neighbours.span(i, mirrored)
                for s in range(begin, end):
                    j, mirror, wall = self.neighbours.read(s, mirrored)
                    r = self.images.offset(x, self.particles.x[j], mirror, wall).norm()
                    other = self.particles.layer[j]
                    w = kernels.wendland(r, 1.0 / self.layers.per_h[layer, other])
                    share = self.layers.volume[other] * w
                    total += share * (mirror * self.particles.v[j] - v)
            self.particles.velocity_exchange[i] = strength * total
        for i in range(n):
            self.particles.v[i] += self.particles.velocity_exchange[i]
