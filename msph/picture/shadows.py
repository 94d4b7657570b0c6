"""Shadows of bodies: maps of the depth along sunlight, of its mean and its variance.

The share of light at a place is estimated from mean m and variance v of the depths around it
(variance shadow maps, Donnelly and Lauritzen 2006): v / (v + (z - m)^2) for a depth z > m. Where
nothing blocks the light, a map holds the depth of the tile or pane that the light meets, so that
the estimate is exact for a plane behind another plane. The width of the mean grows with the
distance from what blocks the light (Yang et al. 2010), by levels of half the resolution each.
"""

import math

import numpy as np
import taichi as ti

from msph.device_table import DeviceTable, f32
from msph.launches import data_oriented, kernel
from msph.picture.body_faces import BodyFaces
from msph.picture.rasteriser import BLOCK, FAR, scan
from msph.picture.shot import UNIT_CORNERS

vec2, vec3, vec4 = ti.math.vec2, ti.math.vec3, ti.math.vec4

# Maps: of bodies in the light above water and under water, and of a container.
SUN, BEAM, OUTER = range(3)
CELLS = 512  # of a map along each side
MEANS, LEVELS = 256, 4  # cells of the finest means along each side; number of levels of means
SHARPNESS = 14.0  # distance from the blocker over the width of the penumbra
SEARCHED = 2  # level at which blockers are searched
BIAS = 2.0  # distance from itself at which a face is not in its own shadow [cells]
ROUGHNESS = 0.5  # least standard deviation of depths [cells]
# First cell of each level, of MEANS / 2^level along each side.
CORNERS = [(0, 0), *((MEANS, MEANS - 2 * (MEANS >> level)) for level in range(1, LEVELS))]
LOG2 = 1.0 / math.log(2.0)
DARK, LIGHT = 0.15, 0.95  # estimated shares of light that count as full shadow and full light


@data_oriented
class Shadows:
    """Maps of the shadows of `faces`. depth: bits of the least depth z [m]; means: of z [m], z^2
    and, for blockers, 1 and z; levels from 1 on are beside level 0, above each other."""

    def __init__(self, faces: BodyFaces, lens):
        self.faces, self.boundary, self.lens = faces, faces.boundary, lens
        self.depth = ti.field(ti.i32, (3, CELLS, CELLS))
        self.means = ti.Vector.field(4, f32, (3, MEANS + MEANS // 2, MEANS))
        # Unit vectors across and along the light, least coordinates along them [m], cells per m.
        self.frames = DeviceTable((3,), right=vec3, up=vec3, away=vec3, least=vec3, scale=f32)

    def draw(self) -> None:
        """Draws the maps of the present bodies and light."""
        shot, rows = self.lens.numbers, []
        corners = UNIT_CORNERS * shot["size"]
        for light in (shot["sun"], shot["beam"], shot["sun"]):
            right = np.cross(light, np.eye(3)[np.abs(light).argmin()])
            right /= np.linalg.norm(right)
            axes = np.stack([right, np.cross(light, right), -light])
            least, most = (corners @ axes.T).min(axis=0), (corners @ axes.T).max(axis=0)
            rows.append((*axes, least, (CELLS - 1) / (most - least)[:2].max()))
        names = "right", "up", "away", "least", "scale"
        self.frames.fill(**dict(zip(names, zip(*rows, strict=True), strict=True)))
        contained = self.boundary.container is not None
        self._draw(self.faces.corners, self.faces.owner, OUTER + contained)

    @kernel
    def _draw(
        self,
        corners: ti.types.ndarray(dtype=ti.f32, ndim=2),
        owner: ti.types.ndarray(dtype=ti.i32, ndim=1),
        maps: ti.i32,
    ):
        ti.loop_config(block_dim=BLOCK)
        for m, i, j in ti.ndrange(maps, CELLS, CELLS):
            self.depth[m, i, j] = ti.bit_cast(f32(FAR), ti.i32)
        ti.loop_config(block_dim=BLOCK)
        for t in range(owner.shape[0]):
            b, h = owner[t], ti.Matrix.zero(f32, 3, 3)
            inside_out = self.boundary.side[b] < 0.0
            for m in range(ti.select(inside_out, OUTER, 0), ti.select(inside_out, maps, OUTER)):
                z = vec3(0.0)
                for k in ti.static(range(3)):
                    p = vec3([corners[t, 3 * k + n] for n in range(3)])
                    c = self.place(m, self.faces.placed(b, p))
                    h[k, :], z[k] = vec3(c.x, c.y, 1.0), c.z
                lo, hi = ti.min(h[0, :], h[1, :], h[2, :]), ti.max(h[0, :], h[1, :], h[2, :])
                lo, hi = ti.max(ti.ceil(lo), 0.0), ti.min(ti.floor(hi), CELLS - 1.0)
                box = ti.cast(ti.Vector([lo.x, lo.y, hi.x, hi.y]), ti.i32)
                scan(h, z, box, vec2(0.0), m, 0, self, 0)
        ti.loop_config(block_dim=BLOCK)
        for m, i, j in ti.ndrange(maps, MEANS, MEANS):
            end, total = self.end(m, 2.0 * i + 0.5, 2.0 * j + 0.5), vec4(0.0)
            for k in ti.static(range(4)):
                z = ti.bit_cast(self.depth[m, 2 * i + k // 2, 2 * j + k % 2], f32)
                cover = ti.select(z < end, 1.0, 0.0)
                z = ti.min(z, end)
                total += vec4(z, z * z, cover, cover * z)
            self.means[m, i, j] = 0.25 * total
        for level in ti.static(range(1, LEVELS)):
            ti.loop_config(block_dim=BLOCK)
            for m, i, j in ti.ndrange(maps, MEANS >> level, MEANS >> level):
                total, at = vec4(0.0), ti.Vector(CORNERS[level - 1])
                for k in ti.static(range(4)):
                    total += self.means[m, at.x + 2 * i + k // 2, at.y + 2 * j + k % 2]
                to = ti.Vector(CORNERS[level])
                self.means[m, to.x + i, to.y + j] = 0.25 * total

    @ti.func
    def place(self, m, p):
        """Returns the place of p [m] in map m [cells], and its depth [m]."""
        f, scale = self.frames, self.frames.scale[m]
        q = vec3(p.dot(f.right[m]), p.dot(f.up[m]), p.dot(f.away[m])) - f.least[m]
        return vec3(scale * q.x, scale * q.y, q.z)

    @ti.func
    def end(self, m, i, j):
        """Returns the depth [m] at which the light of a cell leaves the box."""
        f, size, away = self.frames, self.lens.shot[None].size, self.frames.away[m]
        q = f.least[m] + vec3(i, j, 0.0) / f.scale[m]
        p = q.x * f.right[m] + q.y * f.up[m] + q.z * away
        per = 1.0 / ti.select(abs(away) > 1e-6, away, 1e-6)
        return ti.max(ti.max(-p * per, (size - p) * per).min(), 0.0)

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
        f, at, found = x - i, ti.Vector([MEANS, MEANS - 2 * size]), vec4(0.0)
        if level == 0:
            at = ti.Vector([0, 0])
        low, high = 0.5 * (0.5 - f) ** 2, 0.5 * (0.5 + f) ** 2
        for k in range(9):
            a = ti.Vector([k // 3, k % 3]) - 1
            w = ti.select(a < 0, low, ti.select(a > 0, high, 0.75 - f * f))
            found += w.x * w.y * self.means[m, at + ti.math.clamp(i + a, 0, size - 1)]
        return found

    @ti.func
    def share(self, p, m):
        """Returns the share of light, 0..1, that bodies leave at p [m] in map m."""
        q, scale = self.place(m, p), self.frames.scale[m]
        z, least = q.z - BIAS / scale, (ROUGHNESS / scale) ** 2
        blocked, lit = self.mean(m, SEARCHED, q.xy), 1.0
        if blocked.z > 0.0:
            gap = q.z - blocked.w / blocked.z
            width = ti.max(gap * scale / SHARPNESS, 1e-3)
            level = ti.math.clamp(LOG2 * ti.log(0.25 * width), 0.0, LEVELS - 1.001)
            low = ti.cast(level, ti.i32)
            found = ti.math.mix(self.mean(m, low, q.xy), self.mean(m, low + 1, q.xy), level - low)
            lit = (passed(found, z, least) - DARK) / (LIGHT - DARK)
        return ti.math.clamp(lit, 0.0, 1.0)


@ti.func
def passed(moments, z, least):
    """Returns the estimated share of light at a depth z [m]; least: variance [m^2]."""
    beyond = ti.max(z - moments.x, 0.0)
    variance = ti.max(moments.y - moments.x * moments.x, least)
    return variance / (variance + beyond * beyond)
