"""XSPH: velocities drawn towards those of the neighbours (Monaghan 1989, eq. 2.6, applied to
velocities as in Schechter and Bridson 2012).

It calms what is shorter than the kernel and costs one pass, but it is no viscosity: what it does
depends on the time step and on the size of the particles, about as nu = xsph h^2/(30 dt).
"""

import taichi as ti

from msph.fluid import kernels
from msph.fluid.layers import Layers
from msph.fluid.neighbours import NeighbourList
from msph.fluid.particles import Particles
from msph.launch import data_oriented, kernel


@data_oriented
class Xsph:
    """Takes the share `strength` (-) of the way to the neighbours' velocity in every step.

    Pair exchanges V_i V_j W_ij are equal and opposite, so momentum is kept whatever the layers;
    they are not central, so angular momentum is not.
    """

    def __init__(
        self, layers: Layers, particles: Particles, neighbours: NeighbourList, strength: float
    ):
        self.layers, self.particles, self.neighbours = layers, particles, neighbours
        self.images = neighbours.images
        self.strength = strength

    @kernel
    def run(self, n: ti.i32):
        """v_i += strength sum V_j (v_j - v_i) W_ij."""
        for i in range(n):
            x, v = self.particles.x[i], self.particles.v[i]
            layer, total = self.particles.layer[i], ti.Vector([0.0, 0.0, 0.0])
            for s in range(self.neighbours.start[i], self.neighbours.mirrors[i]):
                j = self.neighbours.index[s]
                r = (x - self.particles.x[j]).norm()
                total += self.weight(layer, j, r) * (self.particles.v[j] - v)
            for s in range(self.neighbours.mirrors[i], self.neighbours.end[i]):
                j, mirror, wall = self.images.read(self.neighbours.index[s])
                r = self.images.offset(x, self.particles.x[j], mirror, wall).norm()
                seen = mirror * self.particles.v[j]
                total += self.weight(layer, j, r) * (seen - v)
            self.particles.exchange[i] = self.strength * total
        for i in range(n):
            self.particles.v[i] += self.particles.exchange[i]

    @ti.func
    def weight(self, layer, j, r):
        """V_j W_ij (-)."""
        other = self.particles.layer[j]
        h = 1.0 / self.layers.per_h[layer, other]
        return self.layers.volume[other] * kernels.wendland(r, h)
