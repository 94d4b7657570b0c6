"""Sums over particles at four points of a z-run at once: coverage and its gradient.

    c(x) = sum over layers l of 1/F_l(x) sum over j in l of V_j w_j W(|x - x_j|, r_j),

poly6 of Gokdogan 2008, eq. 26 divided by rho0, with the reach and weight of particle j (of
thin_water.py, r_l = smoothing * h_l and 1 in deep water), F_l the part of a full kernel's ball
inside the box (fluid_fraction.py) and outside of bodies: inside still water c is 1 up to walls and
bodies, whatever the layers.
"""

import numpy as np
import taichi as ti

from msph.constant_fields import constant_fields
from msph.surface.fluid_fraction import fluid_fraction
from msph.surface.lattice import Lattice
from msph.surface.thin_water import ThinWater
from msph.taichi_internals import data_oriented

vec3, vec4 = ti.math.vec3, ti.math.vec4


@data_oriented
class KernelSums:
    """c and grad c at lattice nodes, gathered from the sorted particles.

    Four nodes of a column share every particle read. inverse_fraction and log_slope
    (L, 3, nodes): 1/F and d(log F)/dx [1/m] of the two walls of an axis, at each node.
    """

    def __init__(self, lattice: Lattice, size, layers, grid, thin: ThinWater, bodies):
        self.lattice, self.grid, self.thin, self.bodies = lattice, grid, thin, bodies
        self.particles, self.layer_count = thin.particles, layers.count
        self.has_bodies = bodies is not None
        self.widest = float(thin.radii.max())
        x = lattice.coordinate.to_numpy()
        pairs = [[fluid_fraction(x[a], size[a], r) for a in range(3)] for r in thin.radii]
        self.inverse_fraction, self.log_slope = constant_fields(
            1.0 / np.array([[p[0] for p in row] for row in pairs]),
            np.array([[p[1] for p in row] for row in pairs]),
        )

    @ti.func
    def beside_bodies(self, i, j, k):
        """Whether kernels round nodes (i, j, k[0..3]) may reach a body."""
        beside = False
        if ti.static(self.has_bodies):
            first = self.lattice.point(i, j, k[0])
            half = 0.5 * (self.lattice.point(i, j, k[3]) - first)
            beside = self.bodies.clearance(first + half) < self.widest + half[2]
        return beside

    @ti.func
    def at_run(self, i, j, k, beside, full: ti.template()):
        """c and the components of grad c [1/m], a vec4 each, at nodes (i, j, k[0..3]).

        beside: whether bodies are looked at. full: by kernels of full reach, for all particles.
        """
        x, y = self.lattice.coordinate[0, i], self.lattice.coordinate[1, j]
        z = vec4(0.0)
        for m in ti.static(range(4)):
            z[m] = self.lattice.coordinate[2, k[m]]
        c, gx, gy, gz = vec4(0.0), vec4(0.0), vec4(0.0), vec4(0.0)
        for layer in range(self.layer_count):
            s, ax, ay, az = self.sum_layer(layer, x, y, z, full)
            if ti.static(self.has_bodies):
                if beside:
                    for m in range(4):
                        share = self.bodies.open_share(vec3(x, y, z[m]), layer)
                        s[m] /= share[0]
                        ax[m] = (ax[m] - s[m] * share[1]) / share[0]
                        ay[m] = (ay[m] - s[m] * share[2]) / share[0]
                        az[m] = (az[m] - s[m] * share[3]) / share[0]
            fxy = self.inverse_fraction[layer, 0, i] * self.inverse_fraction[layer, 1, j]
            hx, hy = self.log_slope[layer, 0, i], self.log_slope[layer, 1, j]
            for m in ti.static(range(4)):
                f = fxy * self.inverse_fraction[layer, 2, k[m]]
                c[m] += f * s[m]
                gx[m] += f * (ax[m] - s[m] * hx)
                gy[m] += f * (ay[m] - s[m] * hy)
                gz[m] += f * (az[m] - s[m] * self.log_slope[layer, 2, k[m]])
        return c, gx, gy, gz

    @ti.func
    def sum_layer(self, layer, x, y, z, full: ti.template()):
        """One layer's sum of V w W at (x, y, z[0..3]), and of V w grad W: four vec4."""
        r = self.thin.reach[layer]
        of_layer = self.thin.full(layer)
        lo = self.grid.cell_of(vec3(x, y, z[0]) - r, layer)
        hi = self.grid.cell_of(vec3(x, y, z[3]) + r, layer)
        low, high = self.grid.lowest[layer], self.grid.highest[layer]
        s, ax, ay, az = vec4(0.0), vec4(0.0), vec4(0.0), vec4(0.0)
        for b in range(ti.max(lo[1], low), ti.min(hi[1], high) + 1):
            for a in range(lo[0], hi[0] + 1):
                begin_end = self.grid.row(layer, a, b, lo[2], hi[2])
                for p in range(begin_end[0], begin_end[1]):
                    xp, own = self.particles.x[p], of_layer
                    if ti.static(not full):
                        own = self.thin.kernel[p]
                    dx, dy, per_r2 = x - xp[0], y - xp[1], own[0]
                    uxy = 1.0 - (dx * dx + dy * dy) * per_r2
                    if uxy > 0.0:
                        dz = z - xp[2]
                        u = ti.max(uxy - dz * dz * per_r2, 0.0)
                        wu2 = own[1] * u * u
                        s += wu2 * u
                        wu2 *= per_r2
                        ax += wu2 * dx
                        ay += wu2 * dy
                        az += wu2 * dz
        return s, -6.0 * ax, -6.0 * ay, -6.0 * az
