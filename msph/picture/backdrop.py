"""Image without water: sky, ground, pool and bodies. It is redrawn only when the view changes, and
where a body moved.

Sky and ground are sampled every COARSE pixels, the box and its contents as in `samples`.
"""

import taichi as ti

from msph.fluid.boundary.body_shapes import END, ROUND
from msph.launches import data_oriented, kernel
from msph.picture.body_faces import KEY_BITS
from msph.picture.moved_bodies import MovedBodies
from msph.picture.pixels import bilinear, word
from msph.picture.pool import MIN_COSINE, RIM, component
from msph.picture.rasteriser import BLOCK, FAR, NO_ITEM, smooth
from msph.picture.room import COARSE, PixelFields
from msph.picture.samples import (
    DETAIL,
    EMPTY,
    REST,
    SKIPPED,
    SPAN,
    STATES,
    UNEVEN,
    UNTILED,
    BlockSampler,
    make_sample,
)
from msph.picture.shot import ray

vec2, vec3, vec4 = ti.math.vec2, ti.math.vec3, ti.math.vec4

RIM_WIDTH = 0.0035  # width of edge lines, over the longest edge of the box
LINE_LIMIT = 1.6  # largest width of the line of one face [pixels]
RIM_STRENGTH, INNER_STRENGTH = 0.85, 0.35  # opacity of edges in front of and behind the water
# Relative difference of depths of one place: the water mesh reaches into bodies, also at the glass.
SAME_DEPTH = 1e-3
# Relative error of depths by keys of the water's triangles.
KEY_SLACK = 5e-3
GLASS, FILM = 0.045, 0.02  # reflectance of a pane, and of a film of water, at normal incidence
# Share of light (-) lost by wet glaze (tiles and containers) and by wet clay; number of dry panes
# that reflect as much as a wet pane.
WET_GLAZE, WET_CLAY, WET_PANES = 0.15, 0.3, 1.5
# Smallest change of sky and ground, linear, that is drawn: a level of a word in the dark.
VISIBLE_CHANGE = 1e-4
# Notes of blocks: hidden by water, or visible.
HIDDEN, VISIBLE = range(2)
# Bits that say what is drawn, beside blocks that moving bodies changed or that were postponed: all
# blocks, but blocks hidden by water are postponed.
WHOLE, FLOODED = 1, 2
# Factors in a sample's kind: of the low wall (0, 1) or body, and of the axis of the entry face.
WALL_OR_BODY, ENTRY_AXIS = 4, 1 << 18


@data_oriented
class Backdrop:
    """Display-referred colours, with the opacity of the edge lines in front of the water.

    Blocks that water hides are postponed while the view changes or bodies move: only the edge lines
    in front are drawn. Bodies themselves are always drawn, since they can be in front of the water.
    """

    def __init__(self, fields: PixelFields, lens, pool, tone, wetness, faces):
        self.lens, self.key, self.wetness = lens, fields.key, wetness
        self.pool, self.tone, self.faces, self.shadows = pool, tone, faces, pool.shadows
        self.raster = faces.raster
        self.colour, self.lines, self.background = fields.backdrop, fields.lines, fields.background
        self.postponed = fields.postponed
        # 1 where a sample of the background changed.
        self.changed = ti.field(ti.i32, fields.background.shape)
        self.state, self.rough = fields.samples.state, fields.rough
        self.whole = self.complete = False
        self.occupied = False  # True if images show bodies
        self.moved = MovedBodies(faces.boundary, fields.room)
        self.sampler = BlockSampler(self, fields.samples)

    def forget(self):
        """Lets all samples of sky and ground change with the next image."""
        self.background.fill(-1.0)

    def take(self, changed):
        """Finds what changed since the last image, and draws the visible faces and shadows of
        bodies; changed: the view is new."""
        self.whole, self.some = changed, False
        if self.occupied:
            found = self.moved.find(self.lens.numbers, changed)
            self.whole, self.some = changed or found is None, bool(found)
            if self.whole or self.some:
                self.faces.draw()
                self.shadows.draw()

    def refresh(self, flooded=False, dried=False):
        """Redraws changed parts. flooded: `key` holds the water of the view; dried: walls and
        bodies are less wet than before."""
        whole = self.whole or dried
        # In a constant view, water may uncover blocks that it hid before.
        flooded = flooded and (whole or self.some)
        if whole or self.some or not self.complete:
            given = WHOLE * whole + FLOODED * flooded
            self.draw_backgrounds(given)
            self.sampler.draw(self.lens.numbers["columns"], self.lens.numbers["rows"], given)
            self.keep_rough(given)
            self.complete = not flooded

    @kernel
    def keep_rough(self, given: ti.i32):
        """Stores which blocks are uneven; blocks that were not drawn keep their values."""
        ti.loop_config(block_dim=BLOCK)
        for a, b in self.rough:
            state = self.state[a, b] % STATES
            if state != SKIPPED or given & WHOLE != 0:
                self.rough[a, b] = ti.cast(state == UNEVEN, ti.i32)

    @kernel
    def draw_backgrounds(self, given: ti.i32):
        """Draws sky and ground in all blocks that will be drawn."""
        columns, rows = self.lens.shot[None].columns, self.lens.shot[None].rows
        ti.loop_config(block_dim=BLOCK)
        for a, b in ti.ndrange(columns // COARSE + 2, rows // COARSE + 2):
            if given & WHOLE != 0:
                self.sample_background(a, b)
        ti.loop_config(block_dim=BLOCK // COARSE)
        for a, b in ti.ndrange(columns // COARSE + 1, rows // COARSE + 1):
            shot, corner, due = self.lens.shot[None], COARSE * ti.Vector([a, b]), False
            if given & WHOLE != 0:
                # Elsewhere sky and ground are visible as before, if they have not changed.
                due = (corner + COARSE >= shot.first).all() and (corner <= shot.last).all()
                for k in range(4):
                    due = due or self.changed[a + k // 2, b + k % 2] == 1
            if due or self.mark(COARSE * a, COARSE * b) > 0:
                self.draw_background(a, b)

    @ti.func
    def in_box(self, i, j):
        """Returns True if the ray of a pixel meets the box."""
        shot = self.lens.shot[None]
        near, far, _, _ = self.pool.slab_test(ray(i, j, shot).normalized(), shot)
        return far > ti.max(near, 0.0)

    @ti.func
    def sample_background(self, a, b):
        shot = self.lens.shot[None]
        colour = self.pool.background(ray(COARSE * a, COARSE * b, shot).normalized(), shot)
        if shot.plain == 1:
            colour = ti.math.mix(shot.low_colour, shot.high_colour, COARSE * b / (shot.rows - 1.0))
        changed = abs(colour - self.background[a, b]).max() > VISIBLE_CHANGE
        self.changed[a, b] = ti.cast(changed, ti.i32)
        if changed:
            self.background[a, b] = colour

    @ti.func
    def draw_background(self, a, b):
        """Draws the block of pixels between four samples of sky and ground. The box is convex:
        inside of its outline, nothing of the background is visible."""
        hidden = True
        for k in range(4):
            hidden = hidden and self.in_box(COARSE * (a + k // 2), COARSE * (b + k % 2))
        low = self.tone.display(self.background[a, b])
        up = self.tone.display(self.background[a, b + 1])
        right = self.tone.display(self.background[a + 1, b])
        far = self.tone.display(self.background[a + 1, b + 1])
        for i in range(COARSE * a, ti.min(COARSE * (a + 1), self.lens.shot[None].columns)):
            u = i / COARSE - a
            start, end = ti.math.mix(low, right, u), ti.math.mix(up, far, u)
            for j in range(COARSE * b, ti.min(COARSE * (b + 1), self.lens.shot[None].rows)):
                self.lines[i, j] = 0.0
                if not hidden:
                    self.colour[i, j] = word(ti.math.mix(start, end, j / COARSE - b))

    @ti.func
    def mark(self, i, j):
        """Returns 1 if a moved body or its shadow may be visible near pixel (i, j)."""
        found = 0
        if ti.static(self.traits.bodies):
            found = self.moved.marks[i // COARSE, j // COARSE]
        return found

    @ti.func
    def begin(self, i0, j0, given):
        """Sets up a block for BlockSampler; given: bits WHOLE, FLOODED. The note is HIDDEN
        if water hides the whole block. A block with an outline of a body is uneven."""
        shot, corner = self.lens.shot[None], ti.Vector([i0, j0])
        due = given & WHOLE != 0 or self.mark(i0, j0) > 0
        boxed = (corner + SPAN >= shot.first).all() and (corner <= shot.last).all()
        boxed = boxed and (due or self.postponed[i0 // SPAN, j0 // SPAN] == 1)
        hidden, even = given & FLOODED != 0, True
        if boxed:
            for k in range(SPAN * SPAN):
                i = ti.min(i0 + k // SPAN, shot.columns - 1)
                j = ti.min(j0 + k % SPAN, shot.rows - 1)
                hidden = hidden and self.water_at(i, j, KEY_SLACK, shot)
            self.postponed[i0 // SPAN, j0 // SPAN] = ti.cast(hidden, ti.i32)
            if ti.static(self.traits.bodies):
                if not hidden:
                    mask = (1 << KEY_BITS) - 1
                    near, even = smooth(self.faces.key, i0, j0, shot.columns, shot.rows, mask)
                    even = even or near == NO_ITEM
        return boxed and (due or not hidden), even, ti.select(hidden, HIDDEN, VISIBLE)

    @ti.func
    def water_at(self, i, j, slack, shot: ti.template()):
        """Returns True for a pixel with water, unless a body is in front of it, or at most `slack`
        times its depth behind: keys have rounded depths."""
        key = self.key[i, j]
        found = key != NO_ITEM
        if ti.static(self.traits.bodies):
            if found:
                w = self.raster.inverse_depth(key, self.raster.item_bits[None], shot)
                found = self.faces.depth(i, j, shot) * w > 1.0 + slack
        return found

    @ti.func
    def wanted(self, i, j):
        return True

    @ti.func
    def trace(self, i, j, note):
        """Returns kind and sample of the ray through a pixel; note: of the pixel's block. Hidden
        blocks get only edge lines."""
        shot = self.lens.shot[None]
        d = ray(i, j, shot).normalized()
        near, far, way_in, axis = self.pool.slab_test(d, shot)
        entry = ti.max(near, 0.0)
        kind, place, light, added = EMPTY, vec4(0.0), vec2(0.0), vec3(0.0)
        left, rim = 1.0, 0.0
        if far > entry:
            share, mirrored = 0.0, d
            if near > 0.0:
                rim = RIM_STRENGTH * self.border(d, near, way_in, 1.0, shot)
                kind += 1 + way_in  # there is an edge between two panes, even in hidden blocks
                if way_in != 1 or shot.lid == 1:
                    share = reflected(GLASS, abs(component(d, way_in)))
                    wet = self.wetness.at(shot.eye + d * near, way_in, shot)
                    share = ti.math.mix(share, 1.0 - (1.0 - share) ** WET_PANES, wet)
                    mirrored *= 1.0 - 2.0 * vec3(way_in == 0, way_in == 1, way_in == 2)
            if note != HIDDEN:
                exits = vec2(entry, far)
                kind, place, light, left, added = self.inside(i, j, d, exits, way_in, axis, shot)
                kind += ENTRY_AXIS * ti.select(near > 0.0, way_in, 3)
                if share > 0.0:
                    left *= 1.0 - share
                    added = ti.math.mix(added, self.pool.far_radiance(mirrored, shot), share)
            if rim > 0.0:
                kind = DETAIL + ti.select(note == HIDDEN, UNTILED, kind)
        elif far > near * (1.0 - 2.0 * SPAN * shot.pixel):
            kind += DETAIL  # the box may begin within the block
        return kind, make_sample(place, light, vec3(left), added, vec4(0.0, 0.0, rim, 0.0))

    @ti.func
    def inside(self, i, j, d, exits, way_in, axis, shot: ti.template()):
        """Shades the contents of the box along the ray d (unit) between its entry and exit, `exits`
        [m], through the walls across the axes way_in and axis. Returns: kind; position [m] and
        pixel width there [m]; light there (sun, sky); share of it that reaches the eye; light added
        on the way."""
        low, far, body, cut = component(d, axis) < 0.0, exits.y, -1, False
        side = FAR  # distance of the entry into a container
        if ti.static(self.traits.bodies):
            body = self.faces.body(i, j)
            if body >= 0:
                per_depth = 1.0 / d.dot(shot.forward)
                depth = self.faces.depth(i, j, shot)
                far, cut = ti.max(exits.x, depth * per_depth), depth == 0.0
                side = self.faces.entry[i, j] * per_depth
        p = shot.eye + d * far
        kind, left, added = axis + WALL_OR_BODY * low, 1.0, vec3(0.0)
        footprint = shot.pixel * far / ti.max(abs(component(d, axis)), MIN_COSINE)
        light = self.pool.lighting(p, axis, low, shot.sun, shot)
        tiled = self.pool.is_tiled(axis, low, shot)
        n = ti.select(low, 1.0, -1.0) * vec3(axis == 0, axis == 1, axis == 2)
        if ti.static(self.traits.bodies):
            lit = 1.0
            if (tiled or body >= 0) and not cut:
                lit = self.pool.sunlit(p, False, body < 0)
            light.x *= lit
            if cut:  # visible on the pane
                n = vec3(way_in == 0, way_in == 1, way_in == 2)
                n *= -ti.math.sign(d.dot(n))
            elif body >= 0:
                n = self.pool.bodies.normal(body, p)
            if body >= 0:
                added, border = self.pool.bodies.shade(body, p, n, shot.sun, lit, shot)
                kind = UNTILED + WALL_OR_BODY * (2 + body) + DETAIL * border
        if body < 0:
            line = INNER_STRENGTH * self.border(d, far, axis, 0.5, shot)
            if not tiled:
                kind, added = UNTILED, bilinear(self.background, vec2(i, j) / COARSE)
            elif line > 0.0:
                kind += DETAIL
                left, added = 1.0 - line, RIM * RIM * line
        # There is no film between a body and the glass that cuts it.
        if (tiled or body >= 0) and not cut:
            wet = self.wetness.at(p, ti.select(body < 0, axis, 3), shot)
            if wet > 0.0:
                mirrored, share = d - 2.0 * d.dot(n) * n, wet * reflected(FILM, -d.dot(n))
                light, left = (1.0 - WET_GLAZE * wet) * light, (1.0 - share) * left
                if ti.static(self.traits.bodies):
                    if body >= 0:
                        clay = self.pool.bodies.boundary.side[body] > 0.0
                        added *= 1.0 - wet * ti.select(clay, WET_CLAY, WET_GLAZE)
                added = ti.math.mix(added, self.pool.mirrored_radiance(p, mirrored, shot), share)
        if ti.static(self.traits.bodies):
            if 0.0 < side < FAR:  # the transparent side of a container reflects the sky faintly
                boundary, q = self.pool.bodies.boundary, shot.eye + d * side
                inwards = boundary.distance_by(
                    self.pool.bodies.numbers.container[None], q, END, ROUND
                ).yzw
                share = reflected(GLASS, d.dot(inwards))
                left *= 1.0 - share
                mirrored = vec3(d.x, abs(d.y), d.z)
                added = ti.math.mix(added, self.pool.far_radiance(mirrored, shot), share)
        return kind, vec4(p, footprint), light, left, added

    @ti.func
    def border(self, d, s, axis, share, shot: ti.template()):
        """Returns the coverage of a pixel by the edge lines of the face across `axis`, at the
        distance s [m] along the ray d; share: of the full line width."""
        footprint = shot.pixel * s / ti.max(abs(component(d, axis)), MIN_COSINE)
        width = ti.min(share * RIM_WIDTH * shot.size.max(), LINE_LIMIT * footprint)
        p = shot.eye + d * s
        room = ti.min(p, shot.size - p) + 1e6 * vec3(axis == 0, axis == 1, axis == 2)
        return ti.math.clamp((width - room.min()) / footprint + 0.5, 0.0, 1.0)

    @ti.func
    def put(self, i, j, kind, sample):
        if kind % DETAIL < EMPTY:
            rim = sample[REST, 2]
            c = self.tone.display(self.pool.colour_of(kind, sample, 1.0, self.lens.shot[None]))
            self.colour[i, j], self.lines[i, j] = word(ti.math.mix(c, RIM, rim)), rim

    @ti.func
    def covers(self, i, j, depth):
        """Returns True if a body is in front of `depth` [m] at a pixel, or in the same place."""
        found = False
        if ti.static(self.traits.bodies):
            found = self.faces.depth(i, j, self.lens.shot[None]) < (1.0 + SAME_DEPTH) * depth
        return found


@ti.func
def reflected(normal, cosine):
    """Returns the reflectance at a cosine of incidence; normal: at 0 degrees (Schlick 1994)."""
    return normal + (1.0 - normal) * (1.0 - ti.math.clamp(cosine, 0.0, 1.0)) ** 5
