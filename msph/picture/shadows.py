"""Shadows of bodies: maps of depths along sunlight, and of means over the places that bodies cover.

With the share c of covered places around a place, and mean m and variance v of their depths, the
share of light is 1 - c (1 - v / (v + (z - m)^2)) for a depth z > m, otherwise 1 (variance shadow
maps, Donnelly and Lauritzen 2006). The width of the means grows with the distance from what blocks
the light (Yang et al. 2010), by levels of half the resolution each.
"""

import math

import numpy as np
import taichi as ti

from msph.device_table import DeviceTable, f32
from msph.launches import data_oriented, kernel
from msph.picture.body_faces import BodyFaces
from msph.picture.rasteriser import BLOCK, FAR, scan
from msph.picture.samples import strips
from msph.picture.shot import UNIT_CORNERS

vec2, vec3 = ti.math.vec2, ti.math.vec3

# Maps: of bodies in the light above water and under water, and of a container.
SUN, BEAM, OUTER = range(3)
CELLS = 512  # of a map along each side
MEANS, LEVELS = 256, 4  # cells of the finest means along each side; number of levels of means
SHARPNESS = 14.0  # distance from the blocker over the width of the penumbra
SEARCHED = 2  # level at which blockers are searched
BIAS = 2.0  # distance from itself at which a face is not in its own shadow [cells]
ROUGHNESS = 0.5  # least standard deviation of depths [cells]
BLOCKS = 1 << LEVELS  # cells of a block along each side: one cell of the coarsest level
LOG2 = 1.0 / math.log(2.0)
DARK, LIGHT = 0.15, 0.95  # estimated shares of light that count as full shadow and full light


@data_oriented
class Shadows:
    """Maps of the shadows of `faces`. depth: bits of the least depth z [m], or of FAR; means: of c,
    c z and c z^2, c 1 where a body covers the place, otherwise 0; levels from 1 on are beside level
    0, above each other."""

    def __init__(self, faces: BodyFaces, lens):
        self.faces, self.boundary, self.lens = faces, faces.boundary, lens
        self.depth = ti.field(ti.i32, (3, CELLS, CELLS))
        self.means = ti.Vector.field(3, f32, (3, MEANS + MEANS // 2, MEANS))
        # Unit vectors across and along the light, least coordinates along them [m], cells per m;
        # first of the blocks of cells that bodies cover or covered.
        self.frames = DeviceTable(
            (3,), right=vec3, up=vec3, away=vec3, least=vec3, scale=f32, first=ti.math.ivec2
        )
        self.covered = [(np.zeros(2, int), np.full(2, CELLS // BLOCKS))] * 3  # blocks of each map

    def draw(self) -> None:
        """Draws the maps of the present bodies and light."""
        shot, rows = self.lens.numbers, []
        corners, bodies = UNIT_CORNERS * shot["size"], self.boundary.corners_at_end()
        sides = [k == self.boundary.container for k in range(len(bodies))]
        size = np.ones(2, int)
        for m, light in enumerate((shot["sun"], shot["beam"], shot["sun"])):
            right = np.cross(light, np.eye(3)[np.abs(light).argmin()])
            right /= np.linalg.norm(right)
            axes = np.stack([right, np.cross(light, right), -light])
            least, most = (corners @ axes.T).min(axis=0), (corners @ axes.T).max(axis=0)
            scale = (CELLS - 1) / (most - least)[:2].max()
            own = bodies[np.array(sides) == (m == OUTER)].reshape(-1, 3)
            at = (own @ axes[:2].T - least[:2]) * scale / BLOCKS
            lo, hi = at.min(axis=0, initial=CELLS), at.max(axis=0, initial=0.0)
            now = [np.clip(x.astype(int), 0, CELLS // BLOCKS) for x in (lo, hi + 1)]
            first, last = (
                np.minimum(now[0], self.covered[m][0]),
                np.maximum(now[1], self.covered[m][1]),
            )
            self.covered[m] = now
            size = np.maximum(size, last - first)
            rows.append((*axes, least, scale, first * BLOCKS))
        names = "right", "up", "away", "least", "scale", "first"
        self.frames.fill(**dict(zip(names, zip(*rows, strict=True), strict=True)))
        maps, (width, height) = OUTER + (self.boundary.container is not None), size * BLOCKS
        self._draw(self.faces.corners, self.faces.owner, maps, width, height)
        for level in range(LEVELS):
            self._average(level, maps, width >> (level + 1), height >> (level + 1))

    @kernel
    def _draw(
        self,
        corners: ti.types.ndarray(dtype=ti.f32, ndim=2),
        owner: ti.types.ndarray(dtype=ti.i32, ndim=1),
        maps: ti.i32,
        width: ti.i32,
        height: ti.i32,
    ):
        strip = self.faces.raster.strip
        ti.loop_config(block_dim=self.faces.raster.block)
        for m, i, s in ti.ndrange(maps, width, strips(height, strip)):
            at = self.frames.first[m] + ti.Vector([i, 0])
            for j in range(s * strip, ti.min((s + 1) * strip, height)):
                if at.x < CELLS and at.y + j < CELLS:
                    self.depth[m, at.x, at.y + j] = ti.bit_cast(f32(FAR), ti.i32)
        ti.loop_config(block_dim=BLOCK)
        for t in range(owner.shape[0]):
            a, b, c = self.faces.corners_of(t, corners, owner)
            inside_out = self.boundary.side[owner[t]] < 0.0
            for m in range(ti.select(inside_out, OUTER, 0), ti.select(inside_out, maps, OUTER)):
                pa, pb, pc = self.place(m, a), self.place(m, b), self.place(m, c)
                lo, hi = ti.min(pa, pb, pc).xy, ti.max(pa, pb, pc).xy
                lo, hi = ti.max(ti.ceil(lo), 0.0), ti.min(ti.floor(hi), CELLS - 1.0)
                towards_sun = (pb - pa).xy.cross((pc - pa).xy) > 0.0
                if towards_sun and (lo <= hi).all():
                    z, box = (
                        vec3(pa.z, pb.z, pc.z),
                        ti.cast(ti.Vector([lo.x, lo.y, hi.x, hi.y]), ti.i32),
                    )
                    pa.z, pb.z, pc.z = 1.0, 1.0, 1.0
                    scan(ti.Matrix.rows([pa, pb, pc]), z, box, vec2(0.0), m, 0, self, 0)

    @kernel
    def _average(self, level: ti.i32, maps: ti.i32, width: ti.i32, height: ti.i32):
        """Computes the means of width x height cells of a level from the cells of the level
        below."""
        strip = self.faces.raster.strip
        ti.loop_config(block_dim=self.faces.raster.block)
        for m, i, s in ti.ndrange(maps, width, strips(height, strip)):
            at = (self.frames.first[m] >> (level + 1)) + ti.Vector([i, 0])
            for j in range(s * strip, ti.min((s + 1) * strip, height)):
                if at.x < MEANS >> level and at.y + j < MEANS >> level:
                    cell, total = at + ti.Vector([0, j]), vec3(0.0)
                    for k in ti.static(range(4)):
                        below = 2 * cell + ti.Vector([k // 2, k % 2])
                        if level == 0:
                            z = ti.bit_cast(self.depth[m, below], f32)
                            total += ti.select(z < FAR, vec3(1.0, z, z * z), vec3(0.0))
                        else:
                            total += self.means[m, corner(level - 1) + below]
                    self.means[m, corner(level) + cell] = 0.25 * total

    @ti.func
    def place(self, m, p):
        """Returns the place of p [m] in map m [cells], and its depth [m]."""
        f, scale = self.frames, self.frames.scale[m]
        q = vec3(p.dot(f.right[m]), p.dot(f.up[m]), p.dot(f.away[m])) - f.least[m]
        return vec3(scale * q.x, scale * q.y, q.z)

    @ti.func
    def put(self, i, j, z, m, kind, shot: ti.template()):
        """Writes a cell of a face at the depth z [m] in map m."""
        bits = ti.bit_cast(ti.max(z, 0.0), ti.i32)
        if bits < self.depth[m, i, j]:
            ti.atomic_min(self.depth[m, i, j], bits)

    @ti.func
    def mean(self, m, level, c):
        """Returns means around a place c [cells] of map m, at a level: quadratic B-splines."""
        size = MEANS >> level
        x = (c + 0.5) / (2 << level) - 0.5
        i = ti.cast(ti.round(x), ti.i32)
        f, at, found = x - i, corner(level), vec3(0.0)
        low, high = 0.5 * (0.5 - f) ** 2, 0.5 * (0.5 + f) ** 2
        for k in range(9):
            a = ti.Vector([k // 3, k % 3]) - 1
            w = ti.select(a < 0, low, ti.select(a > 0, high, 0.75 - f * f))
            found += w.x * w.y * self.means[m, at + ti.math.clamp(i + a, 0, size - 1)]
        return found

    @ti.func
    def share(self, p, m):
        """Returns the share of light, 0..1, that bodies leave at p [m] in map m."""
        q, scale, lit = self.place(m, p), self.frames.scale[m], 1.0
        around = self.mean(m, SEARCHED, q.xy)
        if around.x > 0.0:
            width = ti.max((q.z - around.y / around.x) * scale / SHARPNESS, 1e-3)
            level = ti.math.clamp(LOG2 * ti.log(0.25 * width), 0.0, LEVELS - 1.001)
            low = ti.cast(level, ti.i32)
            found = ti.math.mix(self.mean(m, low, q.xy), self.mean(m, low + 1, q.xy), level - low)
            middle = found.y / ti.max(found.x, 1e-6)
            beyond = ti.max(q.z - BIAS / scale - middle, 0.0)
            variance = found.z / ti.max(found.x, 1e-6) - middle * middle
            variance = ti.max(variance, (ROUGHNESS / scale) ** 2)
            passed = variance / (variance + beyond * beyond)
            passed = ti.math.clamp((passed - DARK) / (LIGHT - DARK), 0.0, 1.0)
            lit = 1.0 - found.x * (1.0 - passed)
        return lit


@ti.func
def corner(level):
    """Returns the first cell of a level of means, of MEANS / 2^level along each side."""
    size = MEANS >> level
    return ti.select(level == 0, 0, 1) * ti.Vector([MEANS, MEANS - 2 * size])
