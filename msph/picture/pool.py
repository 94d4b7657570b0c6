"""The pool: a box of glazed tiles with glass in front, and the ground that it stands on.

A wall is glass when the eye is on its outer side: then it is not drawn but for its edges. Thus a
ray that enters the box by glass or by the open top meets tiles, glass or the top from within.
"""

import taichi as ti

from msph.picture.body_shading import MISSED
from msph.picture.light_sources import SKY_LIGHT, SUN_LIGHT
from msph.picture.rasteriser import BLOCK, FAR
from msph.picture.sky import GROUND, Sky, haze
from msph.taichi_internals import data_oriented, kernel

vec2, vec3, vec4 = ti.math.vec2, ti.math.vec3, ti.math.vec4

PALE, DEEP = vec3(0.60, 0.82, 0.85), vec3(0.27, 0.57, 0.68)  # the two ends of the tiles' tone
BAND = vec3(0.03, 0.16, 0.46)  # the row of blue tiles under the brim
GROUT = vec3(0.90, 0.93, 0.92)
GROUT_WIDTH = 0.075  # of a tile's edge
BEVEL, BEVEL_SHADE = 0.10, 0.07  # of a tile's edge where the glaze rounds off; shade there
WRAP = 0.35  # glazed tiles pass light on: their lit side reaches this far round (cosine)
CORNER, CORNER_REACH = 0.42, 5.0  # depth of the shade in corners; its falloff [1/box height]
RIM = vec3(0.86, 0.93, 0.95)  # the glass edges, display-referred
RIM_WIDTH = 0.0035  # of the longest box edge
LINE_LIMIT = 1.6  # most pixels that one face's edge is wide
RIM_STRENGTH, INNER_STRENGTH = 0.85, 0.35  # opacity of edges before and behind the water
GLASS = 0.045  # reflectance of a pane at right angles
CONTACT, CONTACT_REACH = 0.45, 0.22  # shade under the box; its falloff, of the longest box edge
SHADOW, SHADOW_WAY = vec3(0.52, 0.40, 0.32), 0.30  # light that the box takes; way for half
TONES, GOLDEN = 256, 0.618034
FLATTEST = 0.08  # least cosine by which a pixel's footprint on a wall is stretched
FILTER, SHARPEST = 0.7, 1e-3  # filter width: of the pixel's footprint; least, in tiles
INFINITE, TINY = 1e6, 1e-6


@ti.func
def along(v, axis):
    """Component of v along a runtime axis: selects, as an indexed vector would live in memory."""
    return ti.select(axis == 0, v.x, ti.select(axis == 1, v.y, v.z))


@ti.func
def reciprocal(d):
    """1 / d by component, finite where d vanishes."""
    return 1.0 / (d + ti.select(abs(d) < TINY, TINY, 0.0))


@data_oriented
class Pool:
    def __init__(self, sky: Sky, bodies=None):
        """bodies: the Bodies in the pool, or None."""
        self.sky, self.bodies = sky, bodies
        self.occupied = bodies is not None
        self.tone = ti.field(ti.f32, TONES)  # shade of a tile, 0..1
        self.glaze()

    @kernel
    def glaze(self):
        """Fixed pseudo-random tones: a golden-ratio sequence, shuffled."""
        for i in range(TONES):
            self.tone[i] = ti.math.fract(GOLDEN * ((i * 167 + 13) % TONES))

    @ti.func
    def albedo(self, p, axis, footprint, shot: ti.template()):
        """Tile colour at p [m] on a wall across `axis`; footprint: width of the pixel there [m]."""
        u, su = ti.select(axis == 0, p.z, p.x), ti.select(axis == 0, shot.tiles.z, shot.tiles.x)
        v, sv = ti.select(axis == 1, p.z, p.y), ti.select(axis == 1, shot.tiles.z, shot.tiles.y)
        q = vec2(u * su, v * sv)
        cell = ti.floor(q)
        edge = 0.5 - abs(q - cell - 0.5)  # to the nearest joint, in tiles
        # Box filter: the share of the pixel that joints cover.
        f = ti.max(FILTER * footprint * vec2(su, sv), SHARPEST)
        cover = ti.math.clamp((0.5 * (GROUT_WIDTH + f) - edge) / f, 0.0, 1.0)
        cover *= ti.min(1.0, GROUT_WIDTH / f)
        joint = 1.0 - (1.0 - cover.x) * (1.0 - cover.y)
        k = ti.cast(cell, ti.i32)
        tone = self.tone[(k.x * 73 + k.y * 151 + axis * 37) & (TONES - 1)]
        tone = ti.math.mix(tone, 0.5, ti.min(f.x + f.y, 1.0))
        colour = ti.math.mix(PALE, DEEP, tone)
        if axis != 1 and (shot.size.y - p.y) * sv < 1.0:
            colour = BAND * (0.8 + 0.6 * tone)
        bevel = ti.math.clamp((edge.min() - 0.5 * GROUT_WIDTH) / BEVEL, 0.0, 1.0)
        return ti.math.mix(colour * (1.0 - BEVEL_SHADE * (1.0 - bevel)), GROUT, joint)

    @ti.func
    def light(self, p, axis, low, to_sun, focus, shot: ti.template()):
        """Light on the wall at p; low: the wall at the axis's origin; focus: sun's concentration.

        Sky light is dimmed in corners, sunlight follows Lambert's law.
        """
        room = ti.min(p, shot.size - p) * (CORNER_REACH / shot.size.y)
        room.y = p.y * (CORNER_REACH / shot.size.y)
        dark = 1.0 / (1.0 + room * room)
        shade = 1.0 - CORNER * dark
        open_sky = ti.select(axis == 0, 1.0, shade.x) * ti.select(axis == 1, 1.0, shade.y)
        open_sky *= ti.select(axis == 2, 1.0, shade.z)
        n = along(to_sun, axis)
        lambert = ti.max(ti.select(low, n, -n) + WRAP, 0.0) / (1.0 + WRAP)
        return SKY_LIGHT * open_sky + SUN_LIGHT * (lambert * focus * (0.4 + 0.6 * open_sky))

    @ti.func
    def leave(self, p, r, size):
        """Where a ray from inside leaves the box: distance [m], axis, whether by the low wall."""
        inv = reciprocal(r)
        t = ti.max(-p * inv, (size - p) * inv)
        axis = 0
        s = t.x
        if t.y < s:
            s, axis = t.y, 1
        if t.z < s:
            s, axis = t.z, 2
        return ti.max(s, 0.0), axis, along(r, axis) < 0.0

    @ti.func
    def is_tiled(self, axis, low, shot: ti.template()):
        """Whether the eye is on the inner side of a wall; the top is open, never tiled."""
        e = along(ti.select(low, shot.eye, shot.size - shot.eye), axis)
        return e > 0.0 and (axis != 1 or low)

    @ti.func
    def dry(self, p, axis, low, focus, footprint, shot: ti.template()):
        """Colour of the wall at p in air; focus: the share of the sun it gets."""
        return self.albedo(p, axis, footprint, shot) * self.light(
            p, axis, low, shot.sun, focus, shot
        )

    @ti.func
    def sunlit(self, p, r, to_sun):
        """Share of the sun that bodies leave at p, where a ray r ended."""
        share = 1.0
        if ti.static(self.occupied):
            share = self.bodies.sunlit(p - self.bodies.clear * r, to_sun)
        return share

    @ti.func
    def meet(self, p, r, most):
        """Where a ray from p meets a body: distance [m], MISSED where it does not; which body; and
        the cosine at which it came into the container, or -1."""
        t, body, steep = MISSED, -1, -1.0
        if ti.static(self.occupied):
            t, body, steep = self.bodies.meet(p, r, most)
        return t, body, steep

    @ti.func
    def around(self, d, shot: ti.template()):
        """Radiance of sky or far ground in the box-frame direction d (unit)."""
        return self.sky.radiance(
            vec3(d.dot(shot.right_world), d.dot(shot.up), d.dot(shot.back_world))
        )

    @ti.func
    def country(self, d, shot: ti.template()):
        """What a box-frame ray d from the eye meets outside of the box: sky, or shaded ground."""
        colour = vec3(0.0)
        sine = d.dot(shot.up)
        if sine < -1e-4:
            t = ((shot.eye - 0.5 * shot.size).dot(shot.up) - shot.ground) / -sine
            colour = haze(GROUND * self.ground_light(shot.eye + t * d, shot), sine)
        else:
            colour = self.around(d, shot)
        return colour

    @ti.func
    def ground_light(self, g, shot: ti.template()):
        """1 on open ground, less near the box (it hides sky) and in its shadow (tinted)."""
        away = ti.max(abs(g - 0.5 * shot.size) - 0.5 * shot.size, 0.0).norm_sqr()
        reach = CONTACT_REACH * shot.size.max()
        contact = 1.0 - CONTACT * reach * reach / (reach * reach + away)
        # Sunlight through the box: the longer its way within, the dimmer.
        t0, t1 = -g * shot.sun_inverse, (shot.size - g) * shot.sun_inverse
        enter, leave = ti.min(t0, t1).max(), ti.max(t0, t1).min()
        way = ti.max(leave - ti.max(enter, 0.0), 0.0) / shot.size.max()
        dark = way * way / (way * way + SHADOW_WAY * SHADOW_WAY)
        return contact * (1.0 - SHADOW * dark)

    @ti.func
    def cross(self, d, shot: ti.template()):
        """Slab test of the eye ray d: distances in and out (in > out: a miss), axes of both."""
        inv = reciprocal(d)
        t0, t1 = -shot.eye * inv, (shot.size - shot.eye) * inv
        lo, hi = ti.min(t0, t1), ti.max(t0, t1)
        near, far = lo.max(), hi.min()
        way_in = ti.select(near == lo.x, 0, ti.select(near == lo.y, 1, 2))
        way_out = ti.select(far == hi.x, 0, ti.select(far == hi.y, 1, 2))
        return near, far, way_in, way_out

    @ti.func
    def edge(self, p, axis, width, footprint, shot: ti.template()):
        """Share of the pixel covered by the lines along the borders of the face across `axis`."""
        width = ti.min(width, LINE_LIMIT * footprint)
        room = ti.min(p, shot.size - p)
        across = vec3(axis == 0, axis == 1, axis == 2)
        return ti.math.clamp((width - (room + INFINITE * across).min()) / footprint + 0.5, 0.0, 1.0)

    @ti.func
    def view(self, d, beyond, hidden, shot: ti.template()):
        """Linear colour without water along the eye ray d (unit), and opacity of edges before it.

        beyond: what the ray would meet without the box; hidden: whether water takes its place, so
        that only the opacity counts. Returns (r, g, b, opacity), and the distance of a body.
        """
        colour, rim = beyond, 0.0
        near, far, way_in, axis = self.cross(d, shot)
        hit = far > ti.max(near, 0.0)
        width = RIM_WIDTH * shot.size.max()
        low = along(d, axis) < 0.0
        start = shot.eye + d * ti.max(near, 0.0)
        t, body, steep = MISSED, -1, -1.0
        if hit and not hidden:
            t, body, steep = self.meet(start, d, far - ti.max(near, 0.0))
        tiled = self.is_tiled(axis, low, shot)
        if hit and not hidden and (tiled or body >= 0):
            p = ti.select(body >= 0, start + t * d, shot.eye + d * far)
            lit = self.sunlit(p, d, shot.sun)
            if body < 0:
                footprint = shot.pixel * far / ti.max(abs(along(d, axis)), FLATTEST)
                line = self.edge(p, axis, 0.5 * width, footprint, shot)
                colour = self.dry(p, axis, low, lit, footprint, shot)
                colour = ti.math.mix(colour, RIM * RIM, INNER_STRENGTH * line)
            elif ti.static(self.occupied):
                colour = self.bodies.shade(body, p, shot.sun, lit, shot)
        if ti.static(self.occupied):
            if steep >= 0.0:  # the clear side of a container mirrors the sky faintly
                share = GLASS + (1.0 - GLASS) * (1.0 - steep) ** 5
                colour = ti.math.mix(colour, self.around(vec3(d.x, abs(d.y), d.z), shot), share)
        if hit and near > 0.0:
            steep = abs(along(d, way_in))
            footprint = shot.pixel * near / ti.max(steep, FLATTEST)
            p = shot.eye + d * near
            rim = RIM_STRENGTH * self.edge(p, way_in, width, footprint, shot)
            if way_in != 1 and not hidden:  # a pane mirrors its surroundings faintly
                mirrored = d * vec3(1 - 2 * (way_in == 0), 1, 1 - 2 * (way_in == 2))
                share = GLASS + (1.0 - GLASS) * (1.0 - steep) ** 5
                colour = ti.math.mix(colour, self.around(mirrored, shot), share)
        return vec4(colour, rim), ti.max(near, 0.0) + t


@data_oriented
class Backdrop:
    """The view without water, display-referred, with the opacity of the rim that lies before all.

    Drawn anew only when the camera, the tilt or a body moves. While they change, what water hides
    is left out: its colour is not drawn, only the rim before it. With bodies all is drawn, as they
    may be before the water.
    """

    def __init__(self, width, height, lens, pool, tone):
        self.lens = lens
        self.width, self.height = width, height
        self.pool, self.tone = pool, tone
        self.colour = ti.Vector.field(4, ti.f32, (width, height))
        if pool.occupied:
            self.depth = ti.field(ti.f32, (width, height))  # of bodies along the view [m], or FAR
        self.whole = False

    def refresh(self, changed, raster=None):
        """Bring it up to date; changed: the view is new. raster: what hides it, or None."""
        if self.pool.occupied:
            raster = None
            changed = changed or self.pool.bodies.boundary.moving
        if changed:
            self.draw(raster or self, raster is not None)
            self.whole = raster is None
        elif not self.whole:
            self.draw(self, False)
            self.whole = True

    @ti.func
    def hides(self, i, j):
        """Nothing hides a backdrop from itself."""
        return False

    @kernel
    def draw(self, raster: ti.template(), partly: ti.template()):
        """Sky and ground are smooth: one sample of them serves a block of 2 x 2 pixels."""
        ti.loop_config(block_dim=BLOCK)
        for a, b in ti.ndrange((self.width + 1) // 2, (self.height + 1) // 2):
            shot = self.lens.shot[None]
            corner = shot.origin + shot.du * (2 * a) + shot.dv * (2 * b)
            beyond = self.pool.country((corner + 0.5 * (shot.du + shot.dv)).normalized(), shot)
            around = vec4(self.tone.show(beyond), 0.0)
            block = vec2(2 * a, 2 * b)
            boxed = (block + 1.0 >= shot.lo).all() and (block <= shot.hi).all()
            for i in range(2 * a, ti.min(2 * a + 2, self.width)):
                for j in range(2 * b, ti.min(2 * b + 2, self.height)):
                    if boxed:
                        d = (shot.origin + shot.du * i + shot.dv * j).normalized()
                        hidden = False
                        if ti.static(partly):
                            hidden = raster.hides(i, j)
                        c, body_at = self.pool.view(d, beyond, hidden, shot)
                        if ti.static(self.pool.occupied):
                            depth = body_at * d.dot(shot.forward)
                            self.depth[i, j] = ti.select(body_at < MISSED, depth, FAR)
                        shown = ti.math.mix(self.tone.show(c.xyz), RIM, c.w)
                        self.colour[i, j] = vec4(shown, c.w)
                    else:
                        self.colour[i, j] = around
                        if ti.static(self.pool.occupied):
                            self.depth[i, j] = FAR

    @ti.func
    def covers(self, i, j, depth):
        """Whether a body lies before `depth` [m] at a pixel."""
        found = False
        if ti.static(self.pool.occupied):
            found = self.depth[i, j] < depth
        return found
