"""XSPH: velocities drawn towards those of the neighbours (Monaghan 1989, eq. 2.6, applied to
velocities as in Schechter and Bridson 2012).

It calms what is shorter than the kernel and costs one pass, but it is no viscosity: its effect
depends on the time step and on the size of the particles, about as nu = xsph h^2/(30 dt).
"""

import math

import taichi as ti

from msph.fluid.external_forces import ExternalForces
from msph.fluid.particles import kernels
from msph.fluid.particles.particles import Attribute
from msph.fluid.projection.discretisation import Discretisation
from msph.fluid.projection.parameters import ProjectionParameters
from msph.taichi_internals import data_oriented, kernel


@data_oriented
class Xsph:
    """Takes the share `xsph` (-) of the way to the neighbours' velocity in every step.

    Pair exchanges V_i V_j W_ij are equal and opposite, so momentum is kept whatever the layers;
    they are not central, so angular momentum is not.
    """

    ATTRIBUTES: tuple[Attribute, ...] = ()

    @staticmethod
    def wanted(parameters: ProjectionParameters) -> bool:
        return parameters.xsph > 0.0

    def __init__(self, shared: Discretisation):
        self.layers, self.particles = shared.layers, shared.particles
        self.neighbours, self.images = shared.neighbours, shared.neighbours.images
        self.longest_step = math.inf

    def tune(self, parameters: ProjectionParameters) -> None:
        self.strength = parameters.xsph

    def apply(self, dt: float, external: ExternalForces) -> None:
        """Smooths the velocities, whatever the step."""
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
                    total += self.weight(layer, j, r) * (mirror * self.particles.v[j] - v)
            self.particles.velocity_exchange[i] = strength * total
        for i in range(n):
            self.particles.v[i] += self.particles.velocity_exchange[i]

    @ti.func
    def weight(self, layer, j, r):
        """V_j W_ij (-)."""
        other = self.particles.layer[j]
        h = 1.0 / self.layers.per_h[layer, other]
        return self.layers.volume[other] * kernels.wendland(r, h)
