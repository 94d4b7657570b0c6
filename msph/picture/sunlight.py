"""Sunlight under water: caustics, and the water level of each column.

Caustics are a photon map on the floor y = 0: each mesh triangle that faces the sun is projected
along the light refracted at its corners; the concentration is the area that its light covers under
still water over its area on the map. Points above the floor read the map where their beam
would land.
"""

import taichi as ti

from msph.launches import data_oriented, heavy_kernel
from msph.picture.optics import bend, cosine_beyond
from msph.picture.pixels import bilinear
from msph.picture.rasteriser import BLOCK, on_wall
from msph.picture.shot import CAUSTIC_CELLS, LEVEL_CELLS

vec2 = ti.math.vec2

MIN_UPWARD = 0.3  # smallest slope (cosine) of normals at the water's top
DRY = 1e9
MIN_WET_WEIGHT = 4.0  # weight of wet cells, out of 16 in the 3 x 3, that makes a column wet
MIN_BEAM_DESCENT = 0.1  # smallest descent (sine) of a traced beam
MIN_AREA = 1e-4  # smallest area of a lit patch [map cells, twice]
PHOTON_UNIT = 1024.0  # integer value of light 1 in the map: integer atomics are faster
MAX_CONCENTRATION = 5.0  # limit on the concentration of one triangle's light
HALF_SHADE = 0.6  # light where beams entered through a wall and were not traced
SHORE = 0.04  # depth over which caustics fade in [m]


@data_oriented
class Sunlight:
    def __init__(self, mesh, lens):
        self.mesh, self.lens = mesh, lens
        # The shot holds the number of cells of the level map that are used.
        self.lowest = ti.field(ti.i32, (LEVEL_CELLS, LEVEL_CELLS))  # bits of a positive f32 [m]
        self.level = ti.field(ti.f32, (LEVEL_CELLS, LEVEL_CELLS))  # height of the water's top [m]
        self.landing = ti.Vector.field(2, ti.f32, mesh.vertices.shape[0])  # (x, z) [m]
        self.photons = ti.field(ti.i32, (CAUSTIC_CELLS, CAUSTIC_CELLS))
        # Concentration of light, 1 in still water.
        self.focus = ti.field(ti.f32, (CAUSTIC_CELLS, CAUSTIC_CELLS))

    @ti.func
    def update_levels(self):
        """Computes the level map: lowest upward vertex of each column (droplets are above it)."""
        for i, j in self.lowest:
            self.lowest[i, j] = ti.bit_cast(ti.f32(DRY), ti.i32)
        ti.loop_config(block_dim=BLOCK)
        for v in range(self.mesh.counts[0]):
            if self.mesh.normals[v].y > MIN_UPWARD:
                p = self.mesh.vertices[v]
                n = self.lens.shot[None].level_cells
                c = ti.math.clamp(p.xz / self.lens.shot[None].size.xz * n, 0.0, n - 1.0)
                y = ti.max(p.y, 0.0)
                ti.atomic_min(
                    self.lowest[ti.cast(c.x, ti.i32), ti.cast(c.y, ti.i32)],
                    ti.bit_cast(y, ti.i32),
                )
        for i, j in self.level:
            self.level[i, j] = self.column_level(i, j)

    @ti.func
    def column_level(self, i, j):
        """Returns the mean level of the wet cells in 3 x 3 cells; 0 if the column is dry."""
        total, wet = 0.0, 0.0
        for k in range(9):
            a, b = i + k // 3 - 1, j + k % 3 - 1
            if 0 <= a < LEVEL_CELLS and 0 <= b < LEVEL_CELLS:
                y = ti.bit_cast(self.lowest[a, b], ti.f32)
                if y < DRY:
                    weight = ti.select(a == i, 2.0, 1.0) * ti.select(b == j, 2.0, 1.0)
                    total += weight * y
                    wet += weight
        # Few wet neighbours are a shore, not a gap in the mesh.
        return ti.select(wet >= MIN_WET_WEIGHT, total / ti.max(wet, 1.0), 0.0)

    @ti.func
    def height(self, p, shot: ti.template()):
        """Returns the water level at (x, z) of p [m], interpolated bilinearly."""
        n = shot.level_cells
        c = ti.math.clamp(p.xz / shot.size.xz * n - 0.5, 0.0, n - 1.001)
        return bilinear(self.level, c)

    @heavy_kernel
    def trace_caustics(self):
        """Computes the caustic map: refracts at the vertices, splats the triangles, smooths."""
        for i, j in self.photons:
            self.photons[i, j] = 0
        ti.loop_config(block_dim=BLOCK)
        for v in range(self.mesh.counts[0]):
            n, p, sun = self.mesh.normals[v], self.mesh.vertices[v], self.lens.shot[None].sun
            c = ti.max(n.dot(sun), 0.0)
            eta = self.lens.shot[None].eta
            r = bend(-sun, n, c, cosine_beyond(c, eta), eta)
            self.landing[v] = p.xz - r.xz * (p.y / ti.min(r.y, -MIN_BEAM_DESCENT))
        ti.loop_config(block_dim=BLOCK)
        for t in range(self.mesh.counts[1]):
            self.splat(t, self.lens.shot[None])
        ti.loop_config(block_dim=BLOCK)
        for i, j in self.focus:
            self.focus[i, j] = self.smoothed(i, j)

    @ti.func
    def splat(self, t, shot: ti.template()):
        """Adds the light of triangle t to the map cells whose centres it covers."""
        k = self.mesh.triangles[t]
        pa, pb, pc = self.mesh.vertices[k[0]], self.mesh.vertices[k[1]], self.mesh.vertices[k[2]]
        lit = (pb - pa).cross(pc - pa).dot(shot.sun) > 0.0
        if lit and not on_wall(pa, pb, pc, shot):
            # Area lit under still water: the triangle's shadow on a level plane.
            slant = -shot.sun.xz / ti.max(shot.sun.y, MIN_BEAM_DESCENT)
            ab, ac = (pb - pa).xz + slant * (pb - pa).y, (pc - pa).xz + slant * (pc - pa).y
            still = abs(ab.cross(ac))
            s = shot.map_scale
            a = (self.landing[k[0]] - shot.map_corner) * s
            b = (self.landing[k[1]] - shot.map_corner) * s
            c = (self.landing[k[2]] - shot.map_corner) * s
            area = (b - a).cross(c - a)
            share = still * s.x * s.y / ti.max(abs(area), MIN_AREA)
            light = ti.cast(PHOTON_UNIT * ti.min(share, MAX_CONCENTRATION), ti.i32)
            g = ti.select(area < 0.0, -1.0, 1.0)
            lo = ti.max(ti.ceil(ti.min(a, b, c) - 0.5), 0.0)
            hi = ti.min(ti.floor(ti.max(a, b, c) - 0.5), CAUSTIC_CELLS - 1.0)
            for i in range(ti.cast(lo.x, ti.i32), ti.cast(hi.x, ti.i32) + 1):
                for j in range(ti.cast(lo.y, ti.i32), ti.cast(hi.y, ti.i32) + 1):
                    q = vec2(i, j) + 0.5
                    ea, eb = (b - a).cross(q - a) * g, (c - b).cross(q - b) * g
                    if ea >= 0.0 and eb >= 0.0 and (a - c).cross(q - c) * g >= 0.0:
                        ti.atomic_add(self.photons[i, j], light)

    @ti.func
    def smoothed(self, i, j):
        """Returns the binomial mean of 3 x 3 cells of photons."""
        total = 0
        for k in range(9):
            a, b = k // 3 - 1, k % 3 - 1
            u = ti.math.clamp(i + a, 0, CAUSTIC_CELLS - 1)
            v = ti.math.clamp(j + b, 0, CAUSTIC_CELLS - 1)
            total += self.photons[u, v] * (2 - abs(a)) * (2 - abs(b))
        return total / (16.0 * PHOTON_UNIT)

    @ti.func
    def concentration(self, q, depth, shot: ti.template()):
        """Returns the concentration of sunlight at q, `depth` [m] under the surface; 1 under still
        water. Light through the walls is not traced, and counts as HALF_SHADE."""
        focus = 1.0
        if shot.contrast > 0.0:
            c = (q.xz + shot.drift * q.y - shot.map_corner) * shot.map_scale - 0.5
            traced = bilinear(self.focus, ti.math.clamp(c, 0.0, CAUSTIC_CELLS - 1.001))
            came_in = q.xz - shot.drift * depth
            inside = ti.min(came_in, shot.size.xz - came_in).min()
            trust = ti.math.clamp(inside / SHORE, 0.0, 1.0)
            submerged = ti.math.clamp(depth / SHORE, 0.0, 1.0)
            traced += HALF_SHADE * (1.0 - trust)
            focus = ti.math.mix(1.0, traced, submerged * shot.contrast)
        return focus
