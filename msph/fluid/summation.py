"""Densities, gradients and the pressure solves' diagonal, from one walk over the neighbours."""

import numpy as np
import taichi as ti

from msph.fluid import kernels
from msph.fluid.layers import Layers, pair_support
from msph.fluid.neighbours import NeighbourList
from msph.fluid.obstacles import Walls
from msph.fluid.particles import Particles
from msph.launch import data_oriented, kernel
from msph.tables import tables

# Squared distance [m^2] from which on a direction can be told.
TINY = 1e-16

# Density of the fluid alone from which on a particle is surrounded: no surface or body is near.
SURROUNDED = 0.997
# Looseness where none is known.
UNKNOWN = 1.0

# -1/3 sum V_j r_ij.grad W_ij in still water, by support over spacing: what an even expansion takes
# off c, over the share of the density that it takes. Beyond, the ends'.
SMOOTHINGS = (2.4, 2.45, 2.5, 2.6, 2.8, 3.0)
YIELDS = (0.9964, 0.9962, 0.9970, 0.9980, 1.0016, 1.0011)

# Entries whose gradients are found together: as many numbers as Taichi likes in a vector.
BLOCK = 32

# A particle's density, by the bell kernel too, the sum V_j grad W_ij [1/m], and
# sum V_j |grad W_ij|^2 [1/m^5].
Sums = ti.types.struct(c=ti.f32, bell=ti.f32, g=ti.math.vec3, mirrored=ti.math.vec3, squares=ti.f32)


@data_oriented
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

    Pressure: p grad c moves particles by what c loses when they part. The kernel's sum loses too
    little, and weight was balanced by a pressure .2 (fine) to .4 % (coarse particles) too large. So
    W_ij is divided by that yield, and the particle's own part lowered by as much, which no motion
    changes.

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
        smoothing, supports = (
            np.array([getattr(s, name) for s in layers.specs]) for name in ("smoothing", "support")
        )
        per_yield = 1.0 / np.interp(smoothing, SMOOTHINGS, YIELDS)
        pairs = np.sqrt(per_yield[:, None] * per_yield)
        # What turns the kernels' shapes into W_ij [1/m^3].
        per_h3 = pair_support(supports[:, None], supports) ** -3.0
        scale, bell_scale = kernels.QUARTIC * pairs * per_h3, kernels.BELL * per_h3
        # What a particle adds to its own density, and what bodies' shares are multiplied by.
        peak = kernels.QUARTIC * kernels.QUARTIC_PEAK / smoothing**3
        own = 1.0 - per_yield * (1.0 - peak)
        own_bell = kernels.BELL / smoothing**3
        self.scale, self.bell_scale, self.own, self.own_bell, self.per_yield = tables(
            scale, bell_scale, own, own_bell, per_yield
        )

    @kernel
    def weigh(self, n: ti.i32, alone: ti.template()):
        """weigh_all(), as a kernel."""
        self.weigh_all(n, alone)

    @ti.func
    def weigh_all(self, n, alone: ti.template()):
        """c_i = hidden_i + own_i + sum V_j W_ij, its looseness, g_i = sum V_j grad W_ij, and
        D_i = |g_i|^2 + V_i sum V_j |grad W_ij|^2.

        Sums over neighbours and images; a particle's own images move with it, twice as fast.
        """
        ti.loop_config(serialize=alone)
        for i in range(n):
            layer, x = self.particles.layer[i], self.particles.x[i]
            total = Sums(c=self.own[layer], bell=self.own_bell[layer])
            inside = 0.0  # what bodies take of the kernel's integral
            if ti.static(self.walls.count > 0):
                share = self.per_yield[layer] * self.walls.share(x, layer)
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
        begin, end = self.neighbours.start[i], self.neighbours.end[i]
        for block in range((end - begin + BLOCK - 1) // BLOCK):
            first = begin + BLOCK * block
            g_x, g_y = ti.Vector([0.0] * BLOCK), ti.Vector([0.0] * BLOCK)
            g_z = ti.Vector([0.0] * BLOCK)
            count = ti.min(BLOCK, end - first)
            for k in range(count):
                j, mirror, wall = self.images.read(self.neighbours.index[first + k])
                other = self.particles.layer[j]
                per_h, scale = self.layers.per_h[layer, other], self.scale[layer, other]
                r_ij = self.images.offset(x, self.particles.x[j], mirror, wall)
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
                total.c += volume * scale * (a3 * a - 5.0 * b3 * b + 10.0 * c3 * c)
                u = ti.max(1.0 - q * q, 0.0)
                total.bell += volume * self.bell_scale[layer, other] * (u * u) * (u * u)
                total.g += g
                total.squares += g.norm_sqr() / volume
                total.mirrored += ti.select(j == i, 1.0, 0.0) * g
            for k in range(count):
                self.pair_gradient[first + k] = ti.math.vec3(g_x[k], g_y[k], g_z[k])
