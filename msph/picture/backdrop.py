"""The view without water: country, pool and bodies, kept as long as neither they nor the eye move.

Sky and ground are sampled once every COARSE pixels, the box and what is in it as in `samples`.
"""

import taichi as ti

from msph.picture.pool import FLATTEST, INFINITE, RIM, along
from msph.picture.rasteriser import BLOCK, FAR, NOTHING
from msph.picture.room import COARSE, PixelFields
from msph.picture.samples import (
    BARE,
    DETAIL,
    REST,
    SPAN,
    VOID,
    draw_blocks,
    make_sample,
)
from msph.picture.sunlight import bilinear
from msph.taichi_internals import data_oriented, kernel

vec2, vec3, vec4 = ti.math.vec2, ti.math.vec3, ti.math.vec4

RIM_WIDTH = 0.0035  # of the longest box edge
LINE_LIMIT = 1.6  # most pixels that one face's edge is wide
RIM_STRENGTH, INNER_STRENGTH = 0.85, 0.35  # opacity of edges before and behind the water
GLASS = 0.045  # reflectance of a pane at right angles
# Places in a kind: of the low bit of the wall, or the body; of the axis that the ray came in by.
MORE, NEXT = 4, 1 << 18


@data_oriented
class Backdrop:
    """Display-referred colours, with the opacity of the rim that lies before all.

    Drawn anew only when the camera, the tilt or a body moves. While they change, what the water
    hides is left out: its colour is not drawn, only the rim before it. With bodies all is drawn, as
    they may be before the water.
    """

    def __init__(self, fields: PixelFields, lens, pool, tone):
        self.lens, self.key = lens, fields.key
        self.pool, self.tone = pool, tone
        self.colour, self.country, self.depth = fields.backdrop, fields.country, fields.depth
        self.whole = False

    def refresh(self, changed, flooded=False):
        """Bring it up to date; changed: the view is new; flooded: the water of `key` hides it."""
        if self.pool.occupied:
            flooded = False
            changed = changed or self.pool.bodies.boundary.moving
        flooded = flooded and changed  # in a view that stays, water may uncover what it hid
        if changed or not self.whole:
            self.draw(flooded)
            self.whole = not flooded

    @kernel
    def draw(self, flooded: ti.i32):
        columns, rows = self.lens.shot[None].columns, self.lens.shot[None].rows
        ti.loop_config(block_dim=BLOCK)
        for a, b in ti.ndrange(columns // COARSE + 2, rows // COARSE + 2):
            shot = self.lens.shot[None]
            d = shot.origin + shot.du * (COARSE * a) + shot.dv * (COARSE * b)
            self.country[a, b] = self.pool.country(d.normalized(), shot)
        ti.loop_config(block_dim=BLOCK // COARSE)
        for a, b in ti.ndrange(columns // COARSE + 1, rows // COARSE + 1):
            self.draw_country(a, b)
        draw_blocks(self, flooded, columns, rows)

    @ti.func
    def draw_country(self, a, b):
        """The block of pixels between four samples of sky and ground."""
        low, up = self.tone.show(self.country[a, b]), self.tone.show(self.country[a, b + 1])
        right = self.tone.show(self.country[a + 1, b])
        far = self.tone.show(self.country[a + 1, b + 1])
        for i in range(COARSE * a, ti.min(COARSE * (a + 1), self.lens.shot[None].columns)):
            u = i / COARSE - a
            start, end = ti.math.mix(low, right, u), ti.math.mix(up, far, u)
            for j in range(COARSE * b, ti.min(COARSE * (b + 1), self.lens.shot[None].rows)):
                self.colour[i, j] = vec4(ti.math.mix(start, end, j / COARSE - b), 0.0)
                if ti.static(self.pool.occupied):
                    self.depth[i, j] = FAR

    @ti.func
    def begin(self, i0, j0, flooded):
        """Note: whether water hides the whole block."""
        shot = self.lens.shot[None]
        corner = vec2(i0, j0)
        boxed = (corner + SPAN >= shot.lo).all() and (corner <= shot.hi).all()
        hidden = flooded != 0
        if boxed and hidden:
            for k in range(SPAN * SPAN):
                i = ti.min(i0 + k // SPAN, shot.columns - 1)
                j = ti.min(j0 + k % SPAN, shot.rows - 1)
                hidden = hidden and self.key[i, j] != NOTHING
        return boxed, True, hidden

    @ti.func
    def wanted(self, i, j):
        return True

    @ti.func
    def trace(self, i, j, hidden):
        """What the ray through a pixel finds in the box; hidden: whether only edges count."""
        shot = self.lens.shot[None]
        d = (shot.origin + shot.du * i + shot.dv * j).normalized()
        near, far, way_in, axis = self.pool.cross(d, shot)
        entry = ti.max(near, 0.0)
        kind, place, light, added, depth = VOID, vec4(0.0), vec2(0.0), vec3(0.0), FAR
        left, rim = 1.0, 0.0
        if far > entry:
            share, mirrored = 0.0, d
            if near > 0.0:
                rim = RIM_STRENGTH * self.border(d, near, way_in, 1.0, shot)
                kind += 1 + way_in  # between two panes there is an edge, even where all is hidden
                if way_in != 1:
                    share = pane(abs(along(d, way_in)))
                    mirrored *= vec3(1 - 2 * (way_in == 0), 1, 1 - 2 * (way_in == 2))
            if not hidden:
                kind, place, light, left, added, depth = self.inside(
                    i, j, d, entry, far, axis, shot
                )
                kind += NEXT * ti.select(near > 0.0, way_in, 3)
                if share > 0.0:
                    left *= 1.0 - share
                    added = ti.math.mix(added, self.pool.around(mirrored, shot), share)
            if rim > 0.0:
                kind = DETAIL + ti.select(hidden, BARE, kind)
        elif far > near * (1.0 - 2.0 * SPAN * shot.pixel):
            kind += DETAIL  # the box may begin within the block
        return kind, make_sample(place, light, vec3(left), added, 0.0, depth, rim)

    @ti.func
    def inside(self, i, j, d, entry, far, axis, shot: ti.template()):
        """What the ray d (unit) finds between its ways into and out of the box, `entry` and `far`
        [m], a wall, a body, or what is beyond the glass: kind; place [m] and width of the pixel
        there [m]; light there (sun, sky); share of it that is left; light added; depth of a body
        along the view [m], or FAR."""
        low, depth = along(d, axis) < 0.0, FAR
        start = shot.eye + d * entry
        t, body, steep, close = self.pool.meet(start, d, far - entry, entry, shot)
        p = ti.select(body >= 0, start + t * d, shot.eye + d * far)
        kind, left, added = axis + MORE * low, 1.0, vec3(0.0)
        footprint = shot.pixel * far / ti.max(abs(along(d, axis)), FLATTEST)
        line = INNER_STRENGTH * self.border(d, far, axis, 0.5, shot)
        light = self.pool.lighting(p, axis, low, shot.sun, shot)
        tiled = self.pool.is_tiled(axis, low, shot)
        if not tiled:
            kind, added = BARE, bilinear(self.country, vec2(i, j) / COARSE)
        elif line > 0.0:
            kind += DETAIL
            left, added = 1.0 - line, RIM * RIM * line
        if ti.static(self.pool.occupied):
            lit = 1.0
            if tiled or body >= 0:
                lit = self.pool.sunlit(p, d, shot.sun)
            light.x *= lit
            if body >= 0:
                kind = BARE + MORE * (2 + body)
                added = self.pool.bodies.shade(body, p, shot.sun, lit, shot)
                depth = (entry + t) * d.dot(shot.forward)
            kind += DETAIL * close
            if steep >= 0.0:  # the clear side of a container mirrors the sky faintly
                share = pane(steep)
                left *= 1.0 - share
                mirrored = vec3(d.x, abs(d.y), d.z)
                added = ti.math.mix(added, self.pool.around(mirrored, shot), share)
        return kind, vec4(p, footprint), light, left, added, depth

    @ti.func
    def border(self, d, s, axis, share, shot: ti.template()):
        """How much of the pixel the lines along the borders of the face across `axis` cover, which
        its ray d meets at the distance s [m]; share: of the lines' full width."""
        footprint = shot.pixel * s / ti.max(abs(along(d, axis)), FLATTEST)
        width = ti.min(share * RIM_WIDTH * shot.size.max(), LINE_LIMIT * footprint)
        p = shot.eye + d * s
        room = ti.min(p, shot.size - p) + INFINITE * vec3(axis == 0, axis == 1, axis == 2)
        return ti.math.clamp((width - room.min()) / footprint + 0.5, 0.0, 1.0)

    @ti.func
    def put(self, i, j, kind, sample):
        if kind % DETAIL < VOID:
            rim = sample[REST, 2]
            c = self.tone.show(self.pool.finish(kind, sample, 1.0, self.lens.shot[None]))
            self.colour[i, j] = vec4(ti.math.mix(c, RIM, rim), rim)
            if ti.static(self.pool.occupied):
                self.depth[i, j] = sample[REST, 1]

    @ti.func
    def covers(self, i, j, depth):
        """Whether a body lies before `depth` [m] at a pixel."""
        found = False
        if ti.static(self.pool.occupied):
            found = self.depth[i, j] < depth
        return found


@ti.func
def pane(cosine):
    """Reflectance of a pane of glass by the cosine of incidence (Schlick 1994)."""
    return GLASS + (1.0 - GLASS) * (1.0 - cosine) ** 5
