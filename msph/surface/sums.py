"""Sums over particles at four points of a z-run at once: coverage and its gradient.

    c(x) = sum over layers l of 1/F_l(x) sum over j in l of V_l W(|x - x_j|, r_l),

poly6 with the neighbour's own reach r_l = smoothing * h_l (Gokdogan 2008, eq. 26 divided by
rho0), F_l the part of the kernel's ball inside the box (walls.py): inside still water c is 1 up
to the walls, whatever the layers.
"""

import numpy as np
import taichi as ti

from msph.constant_fields import constant_fields
from msph.surface.fluid_fraction import POLY6, fluid_fraction
from msph.surface.lattice import Lattice
from msph.taichi_internals import data_oriented

vec3, vec4 = ti.math.vec3, ti.math.vec4


@data_oriented
class KernelSums:
    """c and grad c at lattice nodes, gathered from the sorted particles.

    Four nodes of a column share every particle read. reach (L,) [m]; weight (L,): V_l times
    poly6's factor; inverse_fraction and log_slope (L, 3, nodes): 1/F and d(log F)/dx [1/m] of the
    two walls of an axis, at each node.
    """

    def __init__(self, lattice: Lattice, size, layers, grid, particles, smoothing: float):
        self.lattice, self.grid, self.particles = lattice, grid, particles
        self.layer_count = layers.count
        self.radii = smoothing * layers.support.to_numpy().astype(np.float64)
        x = lattice.coordinate.to_numpy()
        pairs = [[fluid_fraction(x[a], size[a], r) for a in range(3)] for r in self.radii]
        self.reach, self.weight, self.inverse_fraction, self.log_slope = constant_fields(
            self.radii,
            layers.volume.to_numpy() * POLY6 / self.radii**3,
            1.0 / np.array([[p[0] for p in row] for row in pairs]),
            np.array([[p[1] for p in row] for row in pairs]),
        )

    @ti.func
    def at_run(self, i, j, k):
        """c and the components of grad c [1/m], a vec4 each, at nodes (i, j, k[0..3])."""
        x, y = self.lattice.coordinate[0, i], self.lattice.coordinate[1, j]
        z = vec4(0.0)
        for m in ti.static(range(4)):
            z[m] = self.lattice.coordinate[2, k[m]]
        c, gx, gy, gz = vec4(0.0), vec4(0.0), vec4(0.0), vec4(0.0)
        for layer in range(self.layer_count):
            s, ax, ay, az = self.sum_layer(layer, x, y, z)
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
    def sum_layer(self, layer, x, y, z):
        """One layer's sum of V W at (x, y, z[0..3]), and of V grad W: four vec4."""
        r = self.reach[layer]
        per_r2 = 1.0 / (r * r)
        lo = self.grid.cell_of(vec3(x, y, z[0]) - r, layer)
        hi = self.grid.cell_of(vec3(x, y, z[3]) + r, layer)
        s, ax, ay, az = vec4(0.0), vec4(0.0), vec4(0.0), vec4(0.0)
        for a in range(lo[0], hi[0] + 1):
            for b in range(lo[1], hi[1] + 1):
                begin_end = self.grid.row(layer, a, b, lo[2], hi[2])
                for p in range(begin_end[0], begin_end[1]):
                    xp = self.particles.x[p]
                    dx, dy = x - xp[0], y - xp[1]
                    uxy = 1.0 - (dx * dx + dy * dy) * per_r2
                    if uxy > 0.0:
                        dz = z - xp[2]
                        u = ti.max(uxy - dz * dz * per_r2, 0.0)
                        u2 = u * u
                        s += u2 * u
                        ax += u2 * dx
                        ay += u2 * dy
                        az += u2 * dz
        w = self.weight[layer]
        slope = -6.0 * w * per_r2
        return w * s, slope * ax, slope * ay, slope * az
