"""Densities, gradients and the pressure solves' diagonal, from one walk over the neighbours."""

import math

import taichi as ti

from msph.fluid import kernels
from msph.fluid.layers import Layers, LayerSpec
from msph.fluid.neighbours import NeighbourList
from msph.fluid.obstacles import Walls
from msph.fluid.particles import Particles

# A particle's density, the sum V_j grad W_ij [1/m], and sum V_j |grad W_ij|^2 [1/m^5].
Sums = ti.types.struct(c=ti.f32, g=ti.math.vec3, squares=ti.f32)


def own_bias(spec: LayerSpec) -> float:
    """Share by which a particle overrates itself in its density (-).

    The sum over a Wendland C2 kernel's N neighbours is too large because the particle sits in the
    kernel's peak, by 0.0294 (N/100)^-0.977 of its own part (Dehnen & Aly 2012, eq. 18 and 19).
    Uncorrected, water at 33 neighbours stands 4 % too high.
    """
    neighbours = 4.0 / 3.0 * math.pi * spec.smoothing**3
    return 0.0294 * (neighbours / 100.0) ** -0.977


@ti.data_oriented
class Summation:
    """Sums of the Wendland C2 kernel over neighbours, images and bodies.

    slope holds V_j dW/dr / r [1/m^2] of each entry of the neighbour list; inflow [1/s], where
    bodies move, what their motion adds to dc/dt.
    """

    def __init__(
        self,
        walls: Walls,
        layers: Layers,
        particles: Particles,
        neighbours: NeighbourList,
        density: float,
    ):
        self.walls, self.layers, self.particles = walls, layers, particles
        self.neighbours, self.images = neighbours, neighbours.images
        self.density = density
        self.slope = ti.field(ti.f32, shape=neighbours.index.shape)
        if walls.moving:
            self.inflow = ti.field(ti.f32, shape=particles.capacity)
        # What a particle adds to its own density, less its bias.
        self.own = ti.field(ti.f32, shape=layers.count)
        for k, spec in enumerate(layers.specs):
            self.own[k] = spec.volume * kernels.WENDLAND / spec.support**3 * (1.0 - own_bias(spec))

    @ti.kernel
    def weigh(self, n: ti.i32):
        """c_i = sum V_j W_ij, g_i = sum V_j grad W_ij, D_i = |g_i|^2 + V_i sum V_j |grad W_ij|^2.

        Sums over neighbours and images; a particle's own images move with it, twice as fast.
        """
        for i in range(n):
            layer = self.particles.layer[i]
            x, h_i = self.particles.x[i], self.layers.support[layer]
            total = Sums(c=self.own[layer])
            if ti.static(self.walls.count > 0):
                wall = self.walls.share(x, layer, h_i)
                total.c += wall[0]
                total.g = ti.Vector([wall[1], wall[2], wall[3]])
                self.particles.wall[i] = total.g
                if ti.static(self.walls.moving):
                    self.inflow[i] = -wall[4]
            for s in range(self.neighbours.start[i], self.neighbours.mirrors[i]):
                j = self.neighbours.index[s]
                self.weigh_pair(s, h_i, j, x - self.particles.x[j], total)
            mirrored = ti.Vector([0.0, 0.0, 0.0])
            for s in range(self.neighbours.mirrors[i], self.neighbours.end[i]):
                j, bits = self.images.read(self.neighbours.index[s])
                r_ij = x - self.images.point(x, self.particles.x[j], bits)
                self.weigh_pair(s, h_i, j, r_ij, total)
                mirrored += ti.select(j == i, 1.0, 0.0) * self.slope[s] * r_ij
            g, volume = total.g, self.layers.volume[layer]
            self.particles.density[i] = total.c * self.density
            self.particles.gradient[i] = g
            self.particles.diagonal[i] = (g + mirrored).norm_sqr() + volume * total.squares

    @ti.func
    def weigh_pair(self, s, h_i, j, r_ij, total: ti.template()):
        """Adds neighbour j to the sums of the Wendland C2 kernel, and stores its slope_s."""
        other = self.particles.layer[j]
        v_j, per_h = self.layers.volume[other], 2.0 / (h_i + self.layers.support[other])
        q = ti.min(r_ij.norm() * per_h, 1.0)
        u = 1.0 - q
        peak = v_j * kernels.WENDLAND * (per_h * per_h * per_h) * (u * u * u)
        total.c += peak * u * (1.0 + 4.0 * q)
        # dW/dr over r: grad W_ij = slope_s r_ij / V_j, without a pole at r = 0.
        slope = -20.0 * peak * (per_h * per_h)
        self.slope[s] = slope
        total.g += slope * r_ij
        total.squares += slope * slope / v_j * r_ij.norm_sqr()
