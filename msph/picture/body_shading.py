"""Shading of bodies, and their intersection with mirrored and refracted rays.

Rays are marched through the signed distances that the fluid uses (sphere tracing, Hart 1996); the
eye sees the triangles of body_faces.py.
"""

import taichi as ti

from msph.device_table import DeviceTable, f32, i32
from msph.fluid.boundary.body_shapes import BALL, END, LINEAR
from msph.fluid.room import MAX_BODIES
from msph.launches import data_oriented
from msph.picture.body_paint import BodyPaint
from msph.picture.shot import slabs
from msph.picture.sky import SKY_LIGHT, SUN_LIGHT
from msph.picture.tone import CLAY

vec2, vec3 = ti.math.vec2, ti.math.vec3

GLAZE = (0.40, 0.54, 0.58)  # default albedo, linear RGB, of containers
BOUNCE = 0.45  # sky light from below, over sky light from above
MAX_STEPS = 96  # largest number of steps of a ray, up to a container and inside
HIT_DISTANCE = 4e-4  # distance at which a ray hits a body, over the longest edge of the box
STEP_FRACTION = 0.9  # step over distance: sampled distances may be too large
MIN_SLOPE = 0.1  # least slope of a distance along a ray, for Newton's step to its zero
OVERSHOOT = 0.08  # least step of a ray in a container, over its length in the container
MISSED = 1e9


@data_oriented
class BodyShading:
    """The bodies of a boundary at the end of a step, as they are rendered."""

    def __init__(self, boundary):
        self.boundary = boundary
        # container: index, or -1. albedo: table by body.
        self.numbers = DeviceTable((), count=i32, near=f32, container=i32)
        self.albedo, self.paint = DeviceTable((MAX_BODIES,), value=vec3), BodyPaint()

    def load(self, box):
        """Loads the boundary's present bodies in a box (Lx, Ly, Lz) [m]."""
        found = self.boundary.container
        self.numbers.fill(
            count=self.boundary.count,
            near=HIT_DISTANCE * max(box),
            container=-1 if found is None else found,
        )
        bodies = self.boundary.bodies
        usual = [GLAZE if k == found else CLAY for k in range(len(bodies))]
        self.albedo.fill(value=[b.albedo or c for b, c in zip(bodies, usual, strict=True)])
        self.paint.load(bodies)

    @ti.func
    def span(self, b, p, r, most, more):
        """Returns the range of t in 0..most where the ray p + t r is inside the bounding sphere and
        the bounding box of body b, enlarged by `more` [m], empty if the ray misses them; and
        p - centre and r, in the frame of the body unless the ray misses the sphere."""
        q, s = p - self.boundary.centre[b, END], r
        along = q.dot(s)
        half = along * along - q.norm_sqr() + (self.boundary.bounding_radius[b] + more) ** 2
        found = vec2(1.0, 0.0)
        if half > 0.0:
            found = vec2(ti.max(-along - ti.sqrt(half), 0.0), ti.min(-along + ti.sqrt(half), most))
        if found[0] < found[1]:
            turn = self.boundary.rotation[b, END].transpose()
            q, s = turn @ q, turn @ s
            # The margin keeps body faces that coincide with the bounding box.
            out = self.boundary.half[b] + more + 8.0 * self.numbers.near[None]
            near, far = slabs(q, s, -out, out)
            found = vec2(ti.max(found[0], near.max()), ti.min(found[1], far.min()))
        return found, q, s

    @ti.func
    def intersect(self, p, r, most, reach, wide):
        """Intersects the ray p + t r (r unit), which begins outside of bodies and inside of a
        container, with the bodies, for t of 0..most. Returns: t of the first hit, or MISSED; index
        of the body; its normal there; True if the ray passes a body within `wide` times its
        distance from the eye, which is `reach` [m] at p."""
        nearest, which, normal, close = MISSED, -1, vec3(0.0), False
        near = self.numbers.near[None]
        for b in range(self.numbers.count[None]):
            part, q, s = self.span(b, p, r, ti.min(most, nearest), wide * (reach + most))
            t, steps = part[0], 0
            margin = MISSED  # smallest distance to the body over distance from the eye
            if self.boundary.kind[b] == BALL and part[0] < part[1]:
                t, margin = self.meet_ball(q, s, self.boundary.half[b][0], reach)
                if t < part[1]:
                    nearest, which, normal = t, b, q + t * s
                t = MISSED
            last, last_d = t, MISSED  # t and distance at the last step
            contains = self.boundary.side[b] < 0.0
            while t < part[1] and steps < MAX_STEPS:
                steps += 1
                found = self.boundary.own_distance(b, q + t * s, LINEAR)
                d, slope = found.x, found.yzw.dot(s)
                # Steps in a container may overshoot, since there is nothing behind its side.
                least = ti.select(contains, ti.min(OVERSHOOT * t, part[1] - t - near), 0.0)
                way = t + ti.max(STEP_FRACTION * abs(d), least, near)
                margin = ti.min(margin, abs(d) / (reach + t))
                if d < near and slope < 0.0:
                    back = ti.select(
                        d < 0.0, (t - last) * d / (last_d - d), d / ti.max(-slope, MIN_SLOPE)
                    )
                    nearest, which, margin, way = t + back, b, MISSED, MISSED
                    normal = found.yzw
                last, last_d, t = t, d, way
            if t < part[1]:
                nearest, which, normal = t, b, -s  # all steps were short: the ray is along a side
            close = close or margin < wide
        if which >= 0:
            normal = (self.boundary.rotation[which, END] @ normal).normalized()
        return nearest, which, normal, close

    @ti.func
    def meet_ball(self, q, s, radius, reach):
        """Returns the t at which the ray q + t s (s unit) enters a ball around 0, or MISSED; and
        the ray's least distance to the ball over the distance from the eye, MISSED for a hit."""
        along, t, margin = -q.dot(s), MISSED, MISSED
        half = radius * radius - (q.norm_sqr() - along * along)
        if half > 0.0 and along > 0.0:
            t = ti.max(along - ti.sqrt(half), 0.0)
        else:
            past = ti.max(along, 0.0)
            margin = ((q + past * s).norm() - radius) / (reach + past)
        return t, margin

    @ti.func
    def nearest(self, b, x):
        """Returns the point of body b's side nearest to x [m]."""
        found = self.boundary.distance(b, x, END)
        return x - found.x * found.yzw

    @ti.func
    def normal(self, b, p):
        """Returns the unit normal of body b near its point p [m]."""
        return self.boundary.normal(b, p, END)

    @ti.func
    def shade(self, b, p, n, to_sun, focus, shot: ti.template()):
        """Returns the colour of body b at p [m] with the normal n, and True near a border between
        its colours; focus: concentration of sunlight there."""
        sky = ti.math.mix(BOUNCE, 1.0, 0.5 + 0.5 * n.dot(shot.up))
        light = SKY_LIGHT * sky + SUN_LIGHT * (ti.max(n.dot(to_sun), 0.0) * focus)
        colour, border = self.albedo.value[b], False
        if self.paint.lattices.first[b] >= 0:
            colour, border = self.paint.at(b, self.boundary.to_body_frame(b, p, END))
        return colour * light, border
