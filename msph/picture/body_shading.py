"""Rendering of bodies: ray intersection and shading of solids and containers.

Rays are marched through the signed distances that the fluid uses (sphere tracing, Hart 1996), so
images show exactly the boundary of the simulation. The side of a container that faces the eye is
transparent, like the panes of the pool.
"""

import taichi as ti

from msph.device_table import DeviceTable, f32, i32
from msph.fluid.boundary.body_shapes import BALL, CUBIC, END, LINEAR, ROUND
from msph.fluid.room import MAX_BODIES
from msph.launches import data_oriented
from msph.picture.shot import PARALLEL
from msph.picture.sky import SKY_LIGHT, SUN_LIGHT

vec2, vec3 = ti.math.vec2, ti.math.vec3

# Default albedo, linear RGB, of solids and of containers.
CLAY, GLAZE = (0.60, 0.26, 0.15), (0.40, 0.54, 0.58)
BOUNCE = 0.45  # sky light from below, over sky light from above
MAX_STEPS = 96  # largest number of steps of a ray, up to a container and inside
HIT_DISTANCE = 4e-4  # distance at which a ray hits a body, over the longest edge of the box
STEP_FRACTION = 0.9  # step over distance: sampled distances may be too large
MIN_SLOPE = 0.1  # least slope of a distance along a ray, for Newton's step to its zero
CUT = 2.0  # depth in a body at which a glass wall cuts the body, over HIT_DISTANCE
OVERSHOOT = 0.08  # least step of a ray in a container, over its length in the container
SHADOW_SHARPNESS = 14.0  # sharpness of shadows
MISSED = 1e9


@data_oriented
class BodyShading:
    """The bodies of a boundary at the end of a step, as they are rendered."""

    def __init__(self, boundary):
        self.boundary = boundary
        # container: index, or -1. paints: table by body.
        self.numbers = DeviceTable((), count=i32, near=f32, container=i32)
        self.paints = DeviceTable((MAX_BODIES,), albedo=vec3)

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
        self.paints.fill(albedo=[b.albedo or c for b, c in zip(bodies, usual, strict=True)])

    @ti.func
    def offset(self):
        """Returns the offset [m] from a surface at which a ray does not hit the surface again."""
        return 8.0 * self.numbers.near[None]

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
            for k in ti.static(range(3)):
                # The margin keeps body faces that coincide with the bounding box.
                out = self.boundary.half[b][k] + more + self.offset()
                per = 1.0 / ti.select(abs(s[k]) > PARALLEL, s[k], PARALLEL)
                near, far = (-out - q[k]) * per, (out - q[k]) * per
                found[0] = ti.max(found[0], ti.min(near, far))
                found[1] = ti.min(found[1], ti.max(near, far))
        return found, q, s

    @ti.func
    def intersect(self, p, r, most, reach, wide, within):
        """Intersects the ray p + t r (r unit) with the bodies, for t of 0..most. Returns: t of the
        first hit, or MISSED; index of the body; t (0 if p is inside) and cosine of incidence at the
        entry into a container, or MISSED and -1; True if the ray passes a body within `wide` times
        its distance from the eye, which is `reach` [m] at p. within: p is in the container, or on
        its side."""
        nearest, which, close = MISSED, -1, False
        entry, entry_cosine = MISSED, -1.0
        near = self.numbers.near[None]
        for b in range(self.numbers.count[None]):
            part, q, s = self.span(b, p, r, ti.min(most, nearest), wide * (reach + most))
            t, entered, steps = part[0], within or self.boundary.side[b] > 0.0, 0
            margin = MISSED  # smallest distance to the body over distance from the eye
            if self.boundary.kind[b] == BALL and part[0] < part[1]:
                t, margin = self.meet_ball(q, s, self.boundary.half[b][0], reach)
                if t < part[1]:
                    nearest, which = t, b
                t = MISSED
            # t, distance and slope at the last step; t at which the ray begins in a container.
            last, last_d, last_slope = t, MISSED, -1.0
            since = ti.select(self.boundary.side[b] < 0.0, t, MISSED)
            convex = self.boundary.convex[b] == 1
            while t < part[1] and steps < MAX_STEPS:
                steps += 1
                found = self.boundary.own_distance(b, q + t * s, LINEAR)
                d, slope = found.x, found.yzw.dot(s)
                # Steps in a container may overshoot, since there is nothing behind its side.
                least = ti.max(ti.min(OVERSHOOT * (t - since), part[1] - t - near), near)
                way = t + ti.max(STEP_FRACTION * abs(d), least)
                margin = ti.min(margin, abs(d) / (reach + t))
                if entered and t <= 0.0 and d < -CUT * near:
                    nearest, which, margin, way = 0.0, b, MISSED, MISSED  # a glass wall cuts b
                elif entered and d < near and slope < 0.0:
                    back = ti.select(
                        d < 0.0, (t - last) * d / (last_d - d), d / ti.max(-slope, MIN_SLOPE)
                    )
                    nearest = self.hit(b, q, s, t + back)
                    which, margin = b, MISSED
                    way = MISSED
                elif not entered:
                    entered = d > near
                    if entered:
                        steps = 0  # the way to a lid can be as long as the way inside
                        since = entry = ti.max(t - d / ti.max(slope, MIN_SLOPE), 0.0)
                        there = self.boundary.own_distance(b, q + entry * s, ROUND)
                        entry_cosine = ti.max(there.yzw.dot(s), 0.0)
                    else:
                        way = t - d + 4.0 * near
                elif convex and slope < 0.0:
                    # The distance from a convex body is a convex function of t, so that Newton's
                    # step ends before the first zero.
                    way = ti.max(way, t - STEP_FRACTION * d / slope)
                elif convex:
                    # The ray leaves. The tangents at the last two steps meet at a lower bound of
                    # the least distance.
                    turn = (last_d - d + t * slope - last * last_slope) / (slope - last_slope)
                    bound = ti.max(last_d + last_slope * (turn - last), 0.0)
                    margin = ti.min(margin, bound / (reach + t))
                    way = MISSED
                last, last_d, last_slope, t = t, d, slope, way
            if entered and t < part[1]:
                nearest, which = t, b  # all steps were short: the ray is along a side
            close = close or margin < wide
        return nearest, which, vec2(entry, entry_cosine), close

    @ti.func
    def meet_ball(self, q, s, radius, reach):
        """Returns the t at which the ray q + t s (s unit) enters a ball around 0, or MISSED; and
        the ray's least distance to the ball over the distance from the eye, MISSED for a hit."""
        along, inside, t, margin = -q.dot(s), radius - q.norm(), MISSED, MISSED
        half = radius * radius - (q.norm_sqr() - along * along)
        if inside > CUT * self.numbers.near[None]:
            t = 0.0  # a glass wall cuts the ball
        elif half > 0.0 and along > 0.0:
            t = ti.max(along - ti.sqrt(half), 0.0)
        else:
            past = ti.max(along, 0.0)
            margin = ((q + past * s).norm() - radius) / (reach + past)
        return t, margin

    @ti.func
    def hit(self, b, q, s, t):
        """Returns the t at which the ray q + t s, in the frame of body b, meets the smooth side of
        the body, by a Newton step from a t close to it: a waterline would show steps of `near` and
        of linear distances."""
        found = self.boundary.own_distance(b, q + t * s, CUBIC)
        return t + found.x / ti.max(-found.yzw.dot(s), MIN_SLOPE)

    @ti.func
    def nearest(self, b, x):
        """Returns the point of body b's side nearest to x [m]."""
        found = self.boundary.distance(b, x, END)
        return x - found.x * found.yzw

    @ti.func
    def is_cut(self, b, p):
        """Returns True if p [m], where a ray meets body b, is inside: a glass wall cuts b."""
        inside = self.boundary.side[b] * self.boundary.distance(b, p, END).x
        return inside < -CUT * self.numbers.near[None]

    @ti.func
    def normal(self, b, p, shot: ti.template()):
        """Returns the unit normal of body b at its visible point p [m], towards the eye's side."""
        n = self.boundary.normal(b, p, END)
        if self.is_cut(b, p):
            # The visible face is the cut, in the plane of the nearest wall.
            least = MISSED
            for k in ti.static(range(3)):
                depth = ti.min(p[k], shot.size[k] - p[k])
                if depth < least:
                    least, n = depth, vec3(0.0)
                    n[k] = ti.select(p[k] < 0.5 * shot.size[k], -1.0, 1.0)
        return n

    @ti.func
    def side_normal(self, p):
        """Returns the unit normal out of the container at a point p [m] of its side."""
        return -self.boundary.normal(self.numbers.container[None], p, END)

    @ti.func
    def sunlit(self, p, to_sun):
        """Returns the share of the sun, 0..1, that bodies leave at p: soft shadows (Quilez), the
        least of SHADOW_SHARPNESS times distance to the body over distance from p. A container
        shades only places outside."""
        share = 1.0
        near = self.numbers.near[None]
        for b in range(self.numbers.count[None]):
            side, convex = self.boundary.side[b], self.boundary.convex[b] == 1
            if side > 0.0 or self.boundary.distance(b, p, END).x < -self.offset():
                # March where the penumbra can reach.
                ahead = (self.boundary.centre[b, END] - p).dot(to_sun)
                ahead += self.boundary.bounding_radius[b]
                part, q, s = self.span(b, p, to_sun, ahead, ahead / SHADOW_SHARPNESS)
                t, steps = ti.max(part[0], self.offset()), 0
                if side > 0.0 and t < part[1] and self.is_cut(b, p):
                    t = MISSED
                if self.boundary.kind[b] == BALL and t < part[1]:
                    share = ti.min(share, self.past_ball(q, s, self.boundary.half[b][0]))
                    t = MISSED
                while t < part[1] and steps < MAX_STEPS:
                    steps += 1
                    found = side * self.boundary.own_distance(b, q + t * s, LINEAR)
                    d = found.x
                    share = ti.min(share, SHADOW_SHARPNESS * d / t)
                    # From here on d/t of a convex body grows.
                    past = convex and t * found.yzw.dot(s) >= d
                    way = t + ti.max(STEP_FRACTION * d, 2.0 * near)
                    t = ti.select(share <= 0.0 or past, MISSED, way)
        return ti.max(share, 0.0)

    @ti.func
    def past_ball(self, q, s, radius):
        """Returns the share of the sun in the direction s that a ball around 0 leaves at q [m]; it
        may exceed 1 outside the penumbra.

        With d(t) the distance of q + t s from the ball, d(t)/t is least at
        t = k |q|^2/(a k + R b sqrt(k)), where k = |q|^2 - R^2, a = -q.s, and b is the distance of
        the ray from the centre.
        """
        along, far2 = -q.dot(s), q.norm_sqr()
        beside = ti.sqrt(ti.max(far2 - along * along, 0.0))
        k = ti.max(far2 - radius * radius, 0.0)
        least = along * k + radius * beside * ti.sqrt(k)
        share = 1.0
        if along > 0.0 and beside < radius:
            share = 0.0
        elif least > 0.0:
            t = ti.max(k * far2 / least, self.offset())
            share = SHADOW_SHARPNESS * ((q + t * s).norm() - radius) / t
        return share

    @ti.func
    def shade(self, b, p, to_sun, focus, shot: ti.template()):
        """Returns the colour of body b at its point p [m]; focus: concentration of sunlight
        there."""
        n = self.normal(b, p, shot)
        sky = ti.math.mix(BOUNCE, 1.0, 0.5 + 0.5 * n.dot(shot.up))
        light = SKY_LIGHT * sky + SUN_LIGHT * (ti.max(n.dot(to_sun), 0.0) * focus)
        return self.paints.albedo[b] * light
