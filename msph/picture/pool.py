"""The pool: a box of glazed tiles with glass in front, and the ground that it stands on.

A wall is glass when the eye is on its outer side: then it is not drawn but for its edges. Thus a
ray that enters the box by glass or by the open top meets tiles, glass or the top from within.
"""

import taichi as ti

from msph.picture.body_shading import MISSED
from msph.picture.light_sources import SKY_LIGHT, SUN_LIGHT
from msph.picture.samples import ADDED, BARE, LEFT, PLACE, SPAN
from msph.picture.sky import GROUND, Sky, haze
from msph.taichi_internals import data_oriented

vec2, vec3 = ti.math.vec2, ti.math.vec3

PALE, DEEP = vec3(0.60, 0.82, 0.85), vec3(0.27, 0.57, 0.68)  # the two ends of the tiles' tone
BAND = vec3(0.03, 0.16, 0.46)  # the row of blue tiles under the brim
GROUT = vec3(0.90, 0.93, 0.92)
GROUT_WIDTH = 0.075  # of a tile's edge
BEVEL, BEVEL_SHADE = 0.10, 0.07  # of a tile's edge where the glaze rounds off; shade there
WRAP = 0.35  # glazed tiles pass light on: their lit side reaches this far round (cosine)
CORNER, CORNER_REACH = 0.42, 5.0  # depth of the shade in corners; its falloff [1/box height]
RIM = vec3(0.86, 0.93, 0.95)  # the glass edges, display-referred
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
        """bodies: the BodyShading of the bodies in the pool, or None. Code for bodies is compiled
        only for a pool that has them."""
        self.sky, self.bodies = sky, bodies
        self.occupied = bodies is not None

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
        # Fixed pseudo-random tones: a golden-ratio sequence, shuffled.
        place = (k.x * 73 + k.y * 151 + axis * 37) & (TONES - 1)
        tone = ti.math.fract(GOLDEN * ((place * 167 + 13) & (TONES - 1)))
        tone = ti.math.mix(tone, 0.5, ti.min(f.x + f.y, 1.0))
        colour = ti.math.mix(PALE, DEEP, tone)
        if axis != 1 and (shot.size.y - p.y) * sv < 1.0:
            colour = BAND * (0.8 + 0.6 * tone)
        bevel = ti.math.clamp((edge.min() - 0.5 * GROUT_WIDTH) / BEVEL, 0.0, 1.0)
        return ti.math.mix(colour * (1.0 - BEVEL_SHADE * (1.0 - bevel)), GROUT, joint)

    @ti.func
    def lighting(self, p, axis, low, to_sun, shot: ti.template()):
        """Sun and sky light on the wall at p, over SUN_LIGHT and SKY_LIGHT; low: the wall at the
        axis's origin.

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
        return vec2(lambert * (0.4 + 0.6 * open_sky), open_sky)

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
    def finish(self, kind, sample, focus, shot: ti.template()):
        """Linear colour of a sample; focus: the sun's concentration at its place."""
        p = vec3(sample[PLACE, 0], sample[PLACE, 1], sample[PLACE, 2])
        left = vec3(sample[LEFT, 0], sample[LEFT, 1], sample[LEFT, 2])
        colour = vec3(sample[ADDED, 0], sample[ADDED, 1], sample[ADDED, 2])
        axis = kind & BARE
        if axis != BARE:
            light = SKY_LIGHT * sample[ADDED, 3] + SUN_LIGHT * (sample[LEFT, 3] * focus)
            colour += self.albedo(p, axis, sample[PLACE, 3], shot) * light * left
        return colour

    @ti.func
    def sunlit(self, p, r, to_sun):
        """Share of the sun that bodies leave at p, where a ray r ended."""
        share = 1.0
        if ti.static(self.occupied):
            share = self.bodies.sunlit(p - self.bodies.clear() * r, to_sun)
        return share

    @ti.func
    def meet(self, p, r, most, reach, shot: ti.template()):
        """Where a ray from p, reach [m] from the eye, meets a body: distance [m], MISSED where it
        does not; which body; the cosine at which it came into the container, or -1; and whether
        the body's outline may be within a block of pixels round the ray."""
        t, body, steep, close = MISSED, -1, -1.0, False
        if ti.static(self.occupied):
            t, body, steep, close = self.bodies.meet(p, r, most, reach, 1.5 * SPAN * shot.pixel)
        return t, body, steep, close

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
