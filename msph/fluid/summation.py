"""Densities, gradients and the pressure solves' diagonal, from one walk over the neighbours."""

import numpy as np
import taichi as ti

from msph.fluid import kernels
from msph.fluid.layers import Layers
from msph.fluid.neighbours import NeighbourList
from msph.fluid.obstacles import Walls
from msph.fluid.particles import Particles
from msph.tables import tables

# Squared distance [m^2] from which on a direction can be told.
TINY = 1e-16

# Density of the fluid alone from which on a particle is surrounded: no surface or body is near.
SURROUNDED = 0.997
# Looseness where none is known.
UNKNOWN = 1.0

# By how much more particles of unlike size see of each other: this times (1 - d_i/d_j)^2, d_j the
# coarser's spacing.
UNLIKE = 0.5
# What makes the bell's factor of the quartic's.
BELL_SCALE = kernels.BELL / kernels.QUARTIC

# Entries whose gradients are found together: as many numbers as Taichi likes in a vector.
BLOCK = 32

# A particle's density, by the bell kernel too, the sum V_j grad W_ij [1/m], and
# sum V_j |grad W_ij|^2 [1/m^5].
Sums = ti.types.struct(c=ti.f32, bell=ti.f32, g=ti.math.vec3, mirrored=ti.math.vec3, squares=ti.f32)


@ti.data_oriented
class Summation:
    """Sums of the quartic B-spline over neighbours, images and bodies.

    Why this kernel: pressure makes an arrangement stiff against shear by as much as strain changes
    the kernel's sums, and sloshing too fast. Of regular lattices strained at constant volume, M5 at
    2.4 spacings changes its sum by a tenth of what Wendland C2, M4 and Wendland C4 do there; and
    it needs no correction for the particle that sits in the kernel's peak, 1.7 % with Wendland C2.

    What c hides: solves keep c = 1 at every particle, and in violent or viscous motion water then
    stood 2 to 6 % too thin, for each particle sits in the peak of its own kernel, and neighbours
    that come near make up for gaps between them. Any other kernel, which no force obeys, sees it:
    of (1 - q^2)^n and wider ones the bell (1 - q^2)^4 of the same support read the bulk density
    within .7 % in all states met. So looseness is bell minus c; its mean round a particle,
    followed slowly, is hidden and added to c; not under tension.

    Mixtures: held at c = 1, unlike particles mixed at random fill .4, 1.6 and 2.5 % less space than
    apart, at mass ratios of 2, 4 and 8: round every particle is a cavity that its own kernel's peak
    makes up for only among its like. So weight pressed layers into each other: in a pool 3.7 m
    deep, of eight layers in thin bands, finest particles lay .6 m down after 3 s of rest, their
    band .06 m thick. W_ij of unlike sizes is therefore raised by UNLIKE (1 - d_i/d_j)^2; then
    volumes add up to .2, .1 and .7 %, and layers stay layers.

    pair_gradient holds V_j grad W_ij [1/m] of each entry of the neighbour list: solves are a third
    faster than with slopes and positions that they must gather; inflow [1/s], where bodies move,
    what their motion adds to dc/dt.
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
        self.pair_gradient = ti.Vector.field(
            3, ti.f32, shape=neighbours.index.shape, layout=ti.Layout.SOA
        )
        if walls.moving:
            self.inflow = ti.field(ti.f32, shape=particles.capacity)
        h = np.array([s.support for s in layers.specs])
        per_h = 2.0 / (h[:, None] + h)
        d = np.array([s.spacing for s in layers.specs])
        ratio = np.minimum(d[:, None], d) / np.maximum(d[:, None], d)
        unlike = 1.0 + UNLIKE * (1.0 - ratio) ** 2
        # 1/h_ij [1/m], and what turns the kernel's shape into W_ij [1/m^3].
        self.per_h, self.scale = tables(per_h, kernels.QUARTIC * per_h**3 * unlike)
        # What a particle adds to its own density.
        volume = np.array([s.volume for s in layers.specs])
        peak = kernels.QUARTIC * kernels.QUARTIC_PEAK
        own = volume / h**3
        self.own, self.own_bell = tables(peak * own, kernels.BELL * own)

    @ti.kernel
    def weigh(self, n: ti.i32, alone: ti.template()):
        """c_i = hidden_i + sum V_j W_ij, its looseness, g_i = sum V_j grad W_ij, and
        D_i = |g_i|^2 + V_i sum V_j |grad W_ij|^2.

        Sums over neighbours and images; a particle's own images move with it, twice as fast.
        """
        ti.loop_config(serialize=alone)
        for i in range(n):
            layer, x = self.particles.layer[i], self.particles.x[i]
            total = Sums(c=self.own[layer], bell=self.own_bell[layer])
            inside = 0.0  # what bodies take of the kernel's integral
            if ti.static(self.walls.count > 0):
                share = self.walls.share(x, layer)
                inside = share[0]
                total.g = ti.Vector([share[1], share[2], share[3]])
                self.particles.wall[i] = total.g
                if ti.static(self.walls.moving):
                    self.inflow[i] = -share[4]
            self.weigh_entries(i, total)
            g, volume = total.g, self.layers.volume[layer]
            # What is hidden counts: else what it compresses near a surface would seem surrounded.
            loose, seen = total.bell - total.c, total.c + self.particles.hidden[i]
            self.particles.looseness[i] = ti.select(seen > SURROUNDED, loose, UNKNOWN)
            self.particles.density[i] = (seen + inside) * self.density
            self.particles.gradient[i] = g
            self.particles.diagonal[i] = (g + total.mirrored).norm_sqr() + volume * total.squares

    @ti.func
    def weigh_entries(self, i, total: ti.template()):
        """Adds all that particle i sees to the sums, and stores its gradients.

        A store might change what the next entry reads, for all that the compiler knows. So they
        wait in a block: twice as fast, for then entries are met eight at a time.
        """
        layer, x = self.particles.layer[i], self.particles.x[i]
        wall = self.images.wall(x)
        begin, end = self.neighbours.start[i], self.neighbours.end[i]
        for block in range((end - begin + BLOCK - 1) // BLOCK):
            first = begin + BLOCK * block
            g_x, g_y = ti.Vector([0.0] * BLOCK), ti.Vector([0.0] * BLOCK)
            g_z = ti.Vector([0.0] * BLOCK)
            count = ti.min(BLOCK, end - first)
            for k in range(count):
                j, mirror = self.images.read(self.neighbours.index[first + k])
                other = self.particles.layer[j]
                per_h, scale = self.per_h[layer, other], self.scale[layer, other]
                r_ij = self.images.offset(x, wall, self.particles.x[j], mirror)
                r2 = ti.max(r_ij.norm_sqr(), TINY)
                per_r = ti.rsqrt(r2)
                # kernels.quartic_shape written out: a division less.
                q = r2 * per_r * per_h
                a, b, c = ti.max(1.0 - q, 0.0), ti.max(0.6 - q, 0.0), ti.max(0.2 - q, 0.0)
                a3, b3, c3 = a * a * a, b * b * b, c * c * c
                volume = self.layers.volume[other]
                slope = -4.0 * volume * scale * per_h * per_r * (a3 - 5.0 * b3 + 10.0 * c3)
                g = slope * r_ij
                g_x[k], g_y[k], g_z[k] = g.x, g.y, g.z
                scale *= volume
                total.c += scale * (a3 * a - 5.0 * b3 * b + 10.0 * c3 * c)
                u = ti.max(1.0 - q * q, 0.0)
                total.bell += BELL_SCALE * scale * (u * u) * (u * u)
                total.g += g
                total.squares += g.norm_sqr() / volume
                total.mirrored += ti.select(j == i, 1.0, 0.0) * g
            for k in range(count):
                self.pair_gradient[first + k] = ti.math.vec3(g_x[k], g_y[k], g_z[k])
