"""Sums over particles at sixteen points at once: coverage and its gradient.

    c(x) = sum over layers l of 1/F_l(x) sum over j in l of V_j W_j(x - x_j)

W_j is the kernel of particle j: poly6 (Gokdogan 2008, eq. 26 divided by rho0) of the reach
r_l = smoothing * h_l in deep water, narrow and stretched in thin water (thin_water.py); F_l is the
part of a full kernel's ball inside the box (fluid_fraction.py) and outside bodies. So c is 1 in
still water up to walls and bodies, for any layers.
"""

import numpy as np
import taichi as ti

from msph.device_table import DeviceTable, f32
from msph.launches import data_oriented
from msph.surface.device_lattice import DeviceLattice
from msph.surface.fluid_fraction import fluid_fraction
from msph.surface.lattice import PAIR, RUN, Lattice
from msph.surface.room import LAYERS, SurfaceRoom
from msph.surface.thin_water import ThinWater

vec2, vec3, vec4 = ti.math.vec2, ti.math.vec3, ti.math.vec4
# Nodes of a tile, and nodes of a tile with equal x.
TILE, HALF_TILE = PAIR * PAIR * RUN, PAIR * RUN
vec16 = ti.types.vector(TILE, ti.f32)


@data_oriented
class KernelSums:
    """Sums of c and grad c at lattice nodes over the sorted particles.

    A tile is 2 x 2 x 4 nodes (i[u], j[v], k[m]) that share every particle read; values at its nodes
    are a vec16 in the order 8 u + 4 v + m. walls, by layer, axis and node, each axis padded to the
    longest: inverse, 1/F, and slope, d(log F)/dx [1/m], of the two walls of the axis.
    """

    def __init__(self, lattice: DeviceLattice, thin: ThinWater, room: SurfaceRoom):
        self.lattice, self.thin, self.numbers = lattice, thin, lattice.numbers
        self.grid, self.particles, self.bodies = thin.grid, thin.particles, thin.bodies
        self.walls = DeviceTable((3 * LAYERS * room.axis,), inverse=f32, slope=f32)

    def load(self, lattice: Lattice, size: tuple[float, float, float], radii: np.ndarray) -> None:
        """Loads a scene. size: box [m]; radii (layers,): reach of each layer's kernel [m]."""
        pairs = [
            fluid_fraction(x, length, r)
            for r in radii
            for x, length in zip(lattice.rows(), size, strict=True)
        ]
        fraction, slope = np.concatenate(pairs, axis=1)
        self.walls.fill(inverse=1.0 / fraction, slope=slope)

    @ti.func
    def near_bodies(self, i, j, k):
        """Returns True if kernels around the nodes of a tile can reach a body."""
        first = self.lattice.point(ti.Vector([i[0], j[0], k[0]]))
        half = 0.5 * (self.lattice.point(ti.Vector([i[1], j[1], k[3]])) - first)
        return self.bodies.clearance(first + half) < self.numbers.widest[None] + half.norm()

    @ti.func
    def sum_tile(self, i, j, k, bodies: ti.template(), full: ti.template()):
        """Computes c and the components of grad c [1/m], a vec16 each, at the nodes of a tile, and
        True if bodies are near the tile.

        bodies: True if the scene has bodies; full: True to use kernels of full reach for all
        particles and to skip grad c.
        """
        near_body = False
        if ti.static(bodies):
            near_body = self.near_bodies(i, j, k)
        x, y, z = vec2(0.0), vec2(0.0), vec4(0.0)
        longest = self.numbers.longest[None]
        for m in ti.static(range(PAIR)):
            x[m] = self.lattice.coordinate.x[i[m]]
            y[m] = self.lattice.coordinate.x[j[m] + longest]
        for m in ti.static(range(RUN)):
            z[m] = self.lattice.coordinate.x[k[m] + 2 * longest]
        c, gx, gy, gz = vec16(0.0), vec16(0.0), vec16(0.0), vec16(0.0)
        for layer in range(self.numbers.layers[None]):
            s, ax, ay, az = self.sum_layer(layer, x, y, z, full)
            first = 3 * layer * longest
            a, b, d = i + first, j + (first + longest), k + (first + 2 * longest)
            # A runtime index keeps the sums in memory as arrays, which the compiler vectorises by
            # eight; as 64 scalars it does not.
            for n in range(TILE):
                u, v, m = n // HALF_TILE, n // RUN % PAIR, n % RUN
                f = self.walls.inverse[a[u]] * self.walls.inverse[b[v]] * self.walls.inverse[d[m]]
                h = vec3(self.walls.slope[a[u]], self.walls.slope[b[v]], self.walls.slope[d[m]])
                if ti.static(bodies):
                    if near_body:
                        share = self.bodies.open_share(vec3(x[u], y[v], z[m]), layer)
                        f /= share[0]
                        h += share.yzw / share[0]
                c[n] += f * s[n]
                if ti.static(not full):
                    gx[n] += f * (ax[n] - s[n] * h[0])
                    gy[n] += f * (ay[n] - s[n] * h[1])
                    gz[n] += f * (az[n] - s[n] * h[2])
        return c, gx, gy, gz, near_body

    @ti.func
    def sum_layer(self, layer, x, y, z, full: ti.template()):
        """Sums V W of a layer at the points (x[u], y[v], z[m]) [m], and V grad W unless full."""
        r = self.thin.by_layer.reach[layer]
        of_layer = self.thin.full(layer)
        low = vec3(x[0], y[0], z[0])
        high = vec3(x[1], y[1], z[3])
        lo, hi = self.grid.cell_of(low - r, layer), self.grid.cell_of(high + r, layer)
        first, last = self.grid.lowest[layer], self.grid.highest[layer]
        s, ax, ay, az = vec16(0.0), vec16(0.0), vec16(0.0), vec16(0.0)
        for b in range(ti.max(lo[1], first), ti.min(hi[1], last) + 1):
            for a in range(lo[0], hi[0] + 1):
                begin_end = self.grid.row(layer, a, b, lo[2], hi[2])
                for p in range(begin_end[0], begin_end[1]):
                    xp, own, narrow = self.particles.x[p], of_layer, False
                    if ti.static(not full):
                        own = self.thin.kernel[p]
                        narrow = own[0] > of_layer[0]
                        if narrow:
                            xp = self.thin.centre[p]
                    dx, dy = x - xp[0], y - xp[1]
                    dx2, dy2 = dx * dx, dy * dy
                    if (ti.min(dx2[0], dx2[1]) + ti.min(dy2[0], dy2[1])) * of_layer[0] < 1.0:
                        ex, ey, ez = vec16(0.0), vec16(0.0), vec16(0.0)
                        for n in ti.static(range(TILE)):
                            ex[n] = dx[n // HALF_TILE]
                            ey[n] = dy[n // RUN % PAIR]
                            ez[n] = z[n % RUN] - xp[2]
                        hx, hy, hz = of_layer[0] * ex, of_layer[0] * ey, of_layer[0] * ez
                        if ti.static(not full):
                            if narrow:
                                d, o = self.thin.squares[p], self.thin.products[p]
                                hx = d.x * ex + o.z * ey + o.y * ez
                                hy = o.z * ex + d.y * ey + o.x * ez
                                hz = o.y * ex + o.x * ey + d.z * ez
                        t = ti.max(1.0 - (ex * hx + ey * hy + ez * hz), 0.0)
                        wt2 = own[1] * t * t
                        s += wt2 * t
                        if ti.static(not full):
                            ax += wt2 * hx
                            ay += wt2 * hy
                            az += wt2 * hz
        return s, -6.0 * ax, -6.0 * ay, -6.0 * az
