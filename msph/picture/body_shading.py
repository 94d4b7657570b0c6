"""Obstacles and the container in the picture: where a ray meets them, and how they are lit.

Rays are marched by the signed distances that hold the water (sphere tracing, Hart 1996), so what is
seen is what the water feels. A container is seen from within: like the pool's panes, the side that
faces the eye is clear.
"""

import taichi as ti

from msph.device_table import DeviceTable, f32, i32
from msph.fluid.boundary.boundary import END
from msph.picture.light_sources import SKY_LIGHT, SUN_LIGHT
from msph.taichi_internals import data_oriented

vec2, vec3 = ti.math.vec2, ti.math.vec3

CLAY, GLAZE = vec3(0.60, 0.26, 0.15), vec3(0.40, 0.54, 0.58)  # albedo of obstacles, of a container
BOUNCE = 0.45  # sky light that comes from below, as a share of that from above
STEPS = 96  # most of one march
NEAR = 4e-4  # how near to a body a ray counts as having met it, as a share of the box's edge
CAREFUL = 0.9  # share of the distance that a step takes: sampled distances may be too far
SOFT = 14.0  # sharpness of shadows
MISSED = 1e9
PARALLEL = 1e-6  # component of a direction that counts as none


@data_oriented
class BodyShading:
    """The bodies of `walls`, as a picture sees them at the end of a step."""

    def __init__(self, boundary):
        self.boundary = boundary
        self.numbers = DeviceTable((), count=i32, near=f32)

    def load(self, box):
        """Draws the bodies that the boundary has now, in a box (Lx, Ly, Lz) [m]."""
        self.numbers.fill(count=self.boundary.count, near=NEAR * max(box))

    @ti.func
    def clear(self):
        """Way [m] off a surface, so as not to meet it again."""
        return 8.0 * self.numbers.near[None]

    @ti.func
    def span(self, b, p, r, most, more):
        """Part of the ray p + t r within both the ball and the box round body b, larger by `more`
        [m]: first and last t of 0..most."""
        c = p - self.boundary.centre[b, END]
        along = c.dot(r)
        half = along * along - c.norm_sqr() + (self.boundary.bounding_radius[b] + more) ** 2
        found = vec2(1.0, 0.0)
        if half > 0.0:
            found = vec2(ti.max(-along - ti.sqrt(half), 0.0), ti.min(-along + ti.sqrt(half), most))
            turn, clear = self.boundary.rotation[b, END].transpose(), self.clear()
            q, s = turn @ c, turn @ r
            for k in ti.static(range(3)):
                # A face may be part of the body.
                out = self.boundary.half[b][k] + more + clear
                per = 1.0 / ti.select(abs(s[k]) > PARALLEL, s[k], PARALLEL)
                near, far = (-out - q[k]) * per, (out - q[k]) * per
                found[0] = ti.max(found[0], ti.min(near, far))
                found[1] = ti.min(found[1], ti.max(near, far))
        return found

    @ti.func
    def meet(self, p, r, most, reach, wide):
        """Where the ray p + t r (r unit) first meets a body within t of 0..most: t, MISSED where
        it does not; which body; the cosine at which it came into the container, or -1; and whether
        it passes a body by less than `wide` times its way from the eye, which is reach [m] at p."""
        nearest, which, steep, close = MISSED, -1, -1.0, False
        near = self.numbers.near[None]
        for b in range(self.numbers.count[None]):
            part = self.span(b, p, r, ti.min(most, nearest), wide * (reach + most))
            t, entered, steps = part[0], self.boundary.side[b] > 0.0, 0
            margin = MISSED  # least distance from the body, over the way from the eye
            while t < part[1] and steps < STEPS:
                steps += 1
                found = self.boundary.distance(b, p + t * r, END)
                d = found.x
                way = t + ti.max(CAREFUL * abs(d), near)
                margin = ti.min(margin, abs(d) / (reach + t))
                if entered and d < near:
                    nearest, which, margin = t, b, MISSED
                    way = MISSED
                elif not entered:
                    entered = d > near
                    if entered:
                        steep = ti.max(found.yzw.dot(r), 0.0)
                    else:
                        way = t - d + 4.0 * near  # how exactly it enters does not matter
                t = way
            close = close or margin < wide
        return nearest, which, steep, close

    @ti.func
    def sunlit(self, p, to_sun):
        """Share of the sun, 0..1, that obstacles leave at p: soft shadows (Quilez)."""
        share = 1.0
        near = self.numbers.near[None]
        for b in range(self.numbers.count[None]):
            if self.boundary.side[b] > 0.0:
                # As far from the body as its shadow is soft.
                ahead = (self.boundary.centre[b, END] - p).dot(to_sun)
                ahead += self.boundary.bounding_radius[b]
                part = self.span(b, p, to_sun, ahead, ahead / SOFT)
                t, steps = ti.max(part[0], self.clear()), 0
                while t < part[1] and steps < STEPS:
                    steps += 1
                    d = self.boundary.distance(b, p + t * to_sun, END).x
                    share = ti.min(share, SOFT * d / t)
                    t = ti.select(share <= 0.0, MISSED, t + ti.max(CAREFUL * d, 2.0 * near))
        return ti.max(share, 0.0)

    @ti.func
    def shade(self, b, p, to_sun, focus, shot: ti.template()):
        """Colour of body b at p [m] on it; focus: the sun's concentration there."""
        n = self.boundary.normal(b, p, END)
        albedo = ti.select(self.boundary.side[b] > 0.0, CLAY, GLAZE)
        sky = ti.math.mix(BOUNCE, 1.0, 0.5 + 0.5 * n.dot(shot.up))
        return albedo * (SKY_LIGHT * sky + SUN_LIGHT * (ti.max(n.dot(to_sun), 0.0) * focus))
