"""Densities, gradients and the pressure solves' diagonal, from one walk over the neighbours."""

import taichi as ti

from msph.fluid import kernels
from msph.fluid.layers import Layers
from msph.fluid.neighbours import NeighbourList
from msph.fluid.obstacles import Walls
from msph.fluid.particles import Particles

# A particle's density, the sum V_j grad W_ij [1/m], and sum V_j |grad W_ij|^2 [1/m^5].
Sums = ti.types.struct(c=ti.f32, g=ti.math.vec3, squares=ti.f32)


@ti.data_oriented
class Summation:
    """Sums of the quartic B-spline over neighbours, images and bodies.

    Why this kernel: pressure makes an arrangement stiff against shear by as much as strain changes
    the kernel's sums, and sloshing too fast. Of regular lattices strained at constant volume, M5 at
    2.4 spacings changes its sum by a tenth of what Wendland C2, M4 and Wendland C4 do there; and
    it needs no correction for the particle that sits in the kernel's peak, 1.7 % with Wendland C2.

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
        # What a particle adds to its own density.
        self.own = ti.field(ti.f32, shape=layers.count)
        for k, spec in enumerate(layers.specs):
            self.own[k] = spec.volume * kernels.QUARTIC / spec.support**3 * kernels.QUARTIC_PEAK

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
                wall = self.walls.share(x, layer)
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
        """Adds neighbour j to the sums, and stores its slope_s."""
        other = self.particles.layer[j]
        v_j, per_h = self.layers.volume[other], 2.0 / (h_i + self.layers.support[other])
        shape = kernels.quartic_shape(r_ij.norm() * per_h)
        scale = v_j * kernels.QUARTIC * (per_h * per_h * per_h)
        total.c += scale * shape.x
        # dW/dr over r: grad W_ij = slope_s r_ij / V_j.
        slope = scale * (per_h * per_h) * shape.y
        self.slope[s] = slope
        total.g += slope * r_ij
        total.squares += slope * slope / v_j * r_ij.norm_sqr()
