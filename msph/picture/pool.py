"""The pool, a box of glazed tiles behind glass, and the ground below it.

A wall is transparent if the eye is on its outer side; only its edges are drawn. So a ray that has
entered the box meets only inner sides of walls.
"""

import taichi as ti

from msph.launches import data_oriented
from msph.picture.body_shading import BodyShading
from msph.picture.samples import ADDED, LEFT, PLACE, UNTILED
from msph.picture.shadows import BEAM, OUTER, Shadows
from msph.picture.shadows import SUN as SUN_MAP
from msph.picture.shot import slabs
from msph.picture.sky import GROUND, SKY_LIGHT, SUN, SUN_LIGHT, Sky, haze

vec2, vec3 = ti.math.vec2, ti.math.vec3

PALE, DEEP = vec3(0.60, 0.82, 0.85), vec3(0.27, 0.57, 0.68)  # range of the tiles' tones
BAND = vec3(0.03, 0.16, 0.46)  # the top row of tiles
GROUT = vec3(0.90, 0.93, 0.92)
GROUT_WIDTH = 0.075  # over a tile's edge
BEVEL, BEVEL_SHADE = 0.10, 0.07  # width of the rounded edge, over a tile's edge; its shade
WRAP = 0.35  # wrap lighting: cosine beyond 90 degrees that is still lit
CORNER, CORNER_REACH = 0.42, 5.0  # depth of the shade in corners; its falloff [1/box height]
RIM = vec3(0.86, 0.93, 0.95)  # the glass edges, display-referred
CONTACT, CONTACT_REACH = 0.45, 0.22  # shade under the box; its falloff, over the longest edge
SHADOW, SHADOW_WAY = vec3(0.52, 0.40, 0.32), 0.30  # light that the box absorbs; path for half
FILM_SUN, FILM_GLOSS = 20.0, 5  # sun on wet walls: brightness; width: cosine^(2^5)
TONES, GOLDEN = 256, 0.618034
MIN_COSINE = 0.08  # smallest cosine for the stretch of a pixel's footprint on a wall
FILTER, SHARPEST = 0.7, 1e-3  # filter width over the pixel's footprint; smallest, in tiles


@ti.func
def component(v, axis):
    """Returns a component of v at a runtime axis, by selects: an indexed vector is in memory."""
    return ti.select(axis == 0, v.x, ti.select(axis == 1, v.y, v.z))


@ti.func
def axis_of(s, v):
    """Returns the first axis along which v has the component s."""
    return ti.select(s == v.x, 0, ti.select(s == v.y, 1, 2))


@data_oriented
class Pool:
    def __init__(self, sky: Sky, bodies: BodyShading, shadows: Shadows):
        self.sky, self.bodies, self.shadows = sky, bodies, shadows

    @ti.func
    def albedo(self, p, axis, footprint, shot: ti.template()):
        """Returns the tile colour at p [m] on a wall across `axis`; footprint: pixel width [m]."""
        u, su = ti.select(axis == 0, p.z, p.x), ti.select(axis == 0, shot.tiles.z, shot.tiles.x)
        v, sv = ti.select(axis == 1, p.z, p.y), ti.select(axis == 1, shot.tiles.z, shot.tiles.y)
        q = vec2(u * su, v * sv)
        cell = ti.floor(q)
        edge = 0.5 - abs(q - cell - 0.5)  # distance to the nearest joint, in tiles
        # Box filter: fraction of the pixel covered by joints.
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
        """Returns sun and sky light on the wall at p, over SUN_LIGHT and SKY_LIGHT: Lambert's law
        for the sun, shaded corners for the sky. low: True for the wall at the axis's origin."""
        room = ti.min(p, shot.size - p) * (CORNER_REACH / shot.size.y)
        room.y = p.y * (CORNER_REACH / shot.size.y)
        dark = 1.0 / (1.0 + room * room)
        shade = 1.0 - CORNER * dark
        open_sky = ti.select(axis == 0, 1.0, shade.x) * ti.select(axis == 1, 1.0, shade.y)
        open_sky *= ti.select(axis == 2, 1.0, shade.z)
        n = component(to_sun, axis)
        lambert = ti.max(ti.select(low, n, -n) + WRAP, 0.0) / (1.0 + WRAP)
        return vec2(lambert * (0.4 + 0.6 * open_sky), open_sky)

    @ti.func
    def exit_face(self, p, r, size):
        """Returns the exit of a ray from the box: distance [m], axis, True for the low wall."""
        _, hi = slabs(p, r, 0.0, size)
        axis = axis_of(hi.min(), hi)
        return ti.max(hi.min(), 0.0), axis, component(r, axis) < 0.0

    @ti.func
    def is_tiled(self, axis, low, shot: ti.template()):
        """Returns True if the eye is on the inner side of a wall; the top is never tiled."""
        e = component(ti.select(low, shot.eye, shot.size - shot.eye), axis)
        return e > 0.0 and (axis != 1 or low)

    @ti.func
    def hides(self, c, shot: ti.template()):
        """Returns True if a tiled wall hides a point outside the box, at c [m] from the eye."""
        d, length = c.normalized(), c.norm()
        near, far, _, axis = self.slab_test(d, shot)
        through = far > ti.max(near, 0.0) and far < length - shot.skin
        return through and self.is_tiled(axis, component(d, axis) < 0.0, shot)

    @ti.func
    def colour_of(self, kind, sample, focus, shot: ti.template()):
        """Returns the linear colour of a sample; focus: concentration of sunlight at its place."""
        p = vec3(sample[PLACE, 0], sample[PLACE, 1], sample[PLACE, 2])
        left = vec3(sample[LEFT, 0], sample[LEFT, 1], sample[LEFT, 2])
        colour = vec3(sample[ADDED, 0], sample[ADDED, 1], sample[ADDED, 2])
        axis = kind & UNTILED
        if axis != UNTILED:
            light = SKY_LIGHT * sample[ADDED, 3] + SUN_LIGHT * (sample[LEFT, 3] * focus)
            colour += self.albedo(p, axis, sample[PLACE, 3], shot) * light * left
        return colour

    @ti.func
    def sunlit(self, p, under, outside):
        """Returns the share of the sun that bodies leave at p [m]; under: p is under water;
        outside: p is not in a container."""
        share = 1.0
        if ti.static(self.traits.bodies):
            contained = outside and self.bodies.numbers.container[None] >= 0
            for k in range(1 + contained):
                m = ti.select(k == 1, OUTER, ti.select(under, BEAM, SUN_MAP))
                share = ti.min(share, self.shadows.share(p, m))
        return share

    @ti.func
    def far_radiance(self, d, shot: ti.template()):
        """Returns the radiance of sky or distant ground in the box-frame direction d (unit)."""
        return self.sky.radiance(shot.to_world @ d)

    @ti.func
    def mirrored_radiance(self, p, r, shot: ti.template()):
        """Returns the radiance along the ray r that a wet wall or body mirrors at p [m]: the mean
        of a tiled wall, or sky with the sun's reflection."""
        _, axis, low = self.exit_face(p, r, shot.size)
        colour = 0.5 * (PALE + DEEP) * SKY_LIGHT
        if not self.is_tiled(axis, low, shot):
            sheen = ti.max(r.dot(shot.sun), 0.0)
            for _ in ti.static(range(FILM_GLOSS)):
                sheen *= sheen
            colour = self.far_radiance(r, shot) + FILM_SUN * sheen * SUN
        return colour

    @ti.func
    def background(self, d, shot: ti.template()):
        """Returns the radiance outside the box along the box-frame ray d: sky or shaded ground."""
        colour = vec3(0.0)
        sine = d.dot(shot.up)
        if sine < -1e-4:
            t = ((shot.eye - 0.5 * shot.size).dot(shot.up) - shot.ground) / -sine
            colour = haze(GROUND * self.ground_light(shot.eye + t * d, shot), sine)
        else:
            colour = self.far_radiance(d, shot)
        return colour

    @ti.func
    def ground_light(self, g, shot: ti.template()):
        """Returns the light at the ground point g, over the light of open ground: less near the box
        and in its tinted shadow."""
        away = ti.max(abs(g - 0.5 * shot.size) - 0.5 * shot.size, 0.0).norm_sqr()
        reach = CONTACT_REACH * shot.size.max()
        contact = 1.0 - CONTACT * reach * reach / (reach * reach + away)
        # Sunlight is absorbed along its path through the box.
        enter, leave = slabs(g, shot.sun, 0.0, shot.size)
        way = ti.max(leave.min() - ti.max(enter.max(), 0.0), 0.0) / shot.size.max()
        dark = way * way / (way * way + SHADOW_WAY * SHADOW_WAY)
        return contact * (1.0 - SHADOW * dark)

    @ti.func
    def slab_test(self, d, shot: ti.template()):
        """Returns distances of entry and exit of the eye ray d (entry > exit: a miss), and axes."""
        lo, hi = slabs(shot.eye, d, 0.0, shot.size)
        near, far = lo.max(), hi.min()
        return near, far, axis_of(near, lo), axis_of(far, hi)
