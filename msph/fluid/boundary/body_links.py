"""Links between particles and bodies, and sums over the links of a body.

A body contributes to the relative density of particles near it, directly and through its mirror
images: an image of body b contributes to particle i what b contributes to the mirror image of the
particle. A link is one such place: particle, body and mirrors, with the distance from the face at
the mirrored place. images.py finds the contribution to the particle's density c_i, and its
gradients G and T by the body's displacement and rotation: c_i changes by -U.G - W.T. A multiplier
q_i gives the body the impulse rho0 V_i q_i G/dt and the angular impulse rho0 V_i q_i T/dt. The two
are adjoint, and momentum is conserved (docs/method.md, "Floating bodies").
"""

import taichi as ti

from msph.errors import BlowUpError
from msph.fluid.boundary.body_shapes import BEGIN, CUBIC
from msph.fluid.boundary.wall_integrals import wendland_behind, wendland_behind_slope
from msph.fluid.part import Part, Parts
from msph.fluid.particles.particles import Attribute
from msph.fluid.room import MAX_BODIES
from msph.launches import data_oriented, kernel
from msph.taichi_internals import on_cpu

vec3 = ti.math.vec3

ATTRIBUTES = (
    Attribute("first_link", "-", "first link with a body", integer=True, carried=False),
    Attribute("links", "-", "with bodies at the last search", integer=True, inherited=False),
)

# Capacity for links per particle: a particle in a corner between two bodies and two walls has eight
# links, most particles have none.
LINKS_PER_PARTICLE = 4
# Least distance of a particle from a mirror, in its spacings: keeps it apart from its image.
NEAREST = 0.01
# Share (-) of the kernel below which the ratio of a body's share to that of a plane tends to 1:
# shares of meshes are inexact by 3e-4.
SMALL_SHARE = 1e-3
# Largest ratio (-) of a body's share to that of a plane: in the corner of a container it is 3.
LARGEST_RATIO = 4.0
# Increase (-) of ratios a < 1, by 1 + CONVEX (1 - a)^2: small bodies displace as much water as they
# should (docs/method.md, "Walls and bodies").
CONVEX = 1.6


@data_oriented
class BodyLinks(Part):
    """The links of the present positions, found by find().

    Tables by link: particle, body, mirrors (bits); place, the mirrored particle from the body's
    centre [m]; distance [m] and normal of the face; ratio a (-) of the body's share of the kernel
    to that of a plane at this distance, larger at convex faces, and its relative slope [1/m];
    gradient G [1/m] and torque T (-); pushed, twisted [N s, N m s]: impulses on the body of the
    present step, for record(). moved [m], turned [rad], by body: displacements by the multipliers
    of the last displace().
    """

    def __init__(self, parts: Parts):
        super().__init__(parts)
        self.capacity = LINKS_PER_PARTICLE * parts.room.particles
        self.particle, self.body, self.mirrors = (
            ti.field(ti.i32, shape=self.capacity) for _ in range(3)
        )
        self.distance, self.ratio = (ti.field(ti.f32, shape=self.capacity) for _ in range(2))
        self.place, self.normal, self.slope = (
            ti.Vector.field(3, ti.f32, shape=self.capacity) for _ in range(3)
        )
        self.gradient, self.torque, self.pushed, self.twisted = (
            ti.Vector.field(3, ti.f32, shape=self.capacity) for _ in range(4)
        )
        self.found = ti.field(ti.i32, shape=())
        # Numbers of bodies and links that the pressure solve visits: none without floating bodies.
        self.free_bodies, self.free_links = (ti.field(ti.i32, shape=()) for _ in range(2))
        self.push, self.twist, self.moved, self.turned = (
            ti.Vector.field(3, ti.f32, shape=MAX_BODIES) for _ in range(4)
        )
        # Sums over links by body: on a CPU in one thread, whose wake-up would take longer.
        self.serial = on_cpu()

    def load(self) -> None:
        """Compiles the kernels that are launched later, if there are bodies."""
        self.found[None] = self.free_bodies[None] = self.free_links[None] = 0
        if self.boundary.count:
            self._add_to_diagonal()
            self._record(0.0)

    def find(self) -> None:
        """Finds the links. Raises BlowUpError if there are more than fit."""
        self.boundary.find_mirrors()
        found = self._find_links(self.particles.count)
        if found > self.capacity:
            raise BlowUpError(
                f"particles meet bodies in {found:,} places, at most {self.capacity:,} fit"
            )
        floats = self.boundary.floating.count > 0
        self.free_bodies[None] = self.boundary.count * floats
        self.free_links[None] = found * floats

    @ti.func
    def rate_by_bodies(self, i):
        """Returns the rate of c_i [1/s] by the motion of bodies."""
        rate, first = 0.0, self.particles.first_link[i]
        for link in range(first, first + self.particles.links[i]):
            b = self.body[link]
            rate -= self.boundary.velocity[b, BEGIN].dot(self.gradient[link])
            rate -= self.boundary.spin[b, BEGIN].dot(self.torque[link])
        return rate

    @ti.func
    def retreat(self, i):
        """Returns the decrease of c_i (-) by the displacements of the last displace()."""
        found, first = 0.0, self.particles.first_link[i]
        if self.free_links[None] > 0:
            for link in range(first, first + self.particles.links[i]):
                b = self.body[link]
                found += self.moved[b].dot(self.gradient[link])
                found += self.turned[b].dot(self.torque[link])
        return found

    @kernel
    def _find_links(self, n: ti.i32) -> ti.i32:
        """Finds the links; returns their number, of which the first `capacity` are stored."""
        self.found[None] = 0
        p = self.particles
        for i in range(n):
            x, h = p.x[i], self.boundary.support[p.layer[i]]
            near = self.walls.near(x, h) & self._mirroring_walls()
            near &= ~self.apertures.beyond(x)
            combinations = self.walls.combinations(near)
            count = 0
            for number in range(combinations):
                count += self._count(i, self.walls.combination(number, near), h)
            # Outside the loops, in which Mesa's software driver loses atomic operations.
            link = ti.atomic_add(self.found[None], count)
            first, limit = link, ti.min(link + count, self.capacity)
            if count > 0:
                for number in range(combinations):
                    self._add(i, self.walls.combination(number, near), h, limit, link)
            p.first_link[i], p.links[i] = first, link - first
            # By rounding, a link that was counted may not be found: it has no effect.
            for empty in range(link, limit):
                self._begin(empty, i, 0, 0)
        return self.found[None]

    @ti.func
    def _begin(self, link, i, b, mirrors):
        """Sets particle, body and mirrors of a link, whose impulses and gradients are 0."""
        self.particle[link], self.body[link], self.mirrors[link] = i, b, mirrors
        self.gradient[link] = self.torque[link] = vec3(0.0)
        self.pushed[link] = self.twisted[link] = vec3(0.0)

    @ti.func
    def _mirroring_walls(self):
        """Returns the walls that mirror a body, as bits."""
        found = 0
        for b in range(self.constants.bodies[None]):
            found |= self.boundary.mirroring[b]
        return found

    @ti.func
    def _reaches(self, b, x, mirrors, h):
        """Returns False if body b is certainly farther than h [m] from the position x [m] mirrored
        by `mirrors`, or is not mirrored by these walls."""
        mirrored = self.walls.by_walls(mirrors, self.boundary.mirroring[b]) == mirrors
        return mirrored and self.boundary.reaches(b, x, h, BEGIN)

    @ti.func
    def _links(self, b, x, layer, h):
        """Returns True if body b within reach of x [m] has a gradient there: a link."""
        return self.boundary.meets_kernel(b, self.boundary.to_body_frame(b, x, BEGIN), layer, h)

    @ti.func
    def _count(self, i, mirrors, h):
        """Returns the number of links that _add() stores."""
        mirror, wall = self.walls.mirror_and_wall(mirrors)
        x, found = self.walls.reflected(self.particles.x[i], mirror, wall), 0
        for b in range(self.constants.bodies[None]):
            if self._reaches(b, x, mirrors, h) and self._links(b, x, self.particles.layer[i], h):
                found += 1
        return found

    @ti.func
    def _add(self, i, mirrors, h, limit, link: ti.template()):
        """Stores the links of particle i by `mirrors` from index `link` to `limit`, and advances
        it."""
        mirror, wall = self.walls.mirror_and_wall(mirrors)
        x = self.walls.reflected(self.particles.x[i], mirror, wall)
        for b in range(self.constants.bodies[None]):
            if self._reaches(b, x, mirrors, h) and self._links(b, x, self.particles.layer[i], h):
                if link < limit:
                    self._begin(link, i, b, mirrors)
                    self._measure(link, b, x, self.particles.layer[i], h)
                    link += 1

    @ti.func
    def _measure(self, link, b, x, layer, h):
        """Stores the place, distance, normal and ratio of a link at the mirrored place x [m]."""
        near, spacing = self.boundary.distance_by(b, x, BEGIN, CUBIC), self.layers.spacing[layer]
        self.place[link], self.normal[link] = x - self.boundary.centre[b, BEGIN], near.yzw
        self.distance[link] = ti.max(near.x, NEAREST * spacing)
        share = self.boundary.joint_share(b, x, layer, h)
        whole = ti.max(share.x, 0.0) + SMALL_SHARE
        plane = wendland_behind(near.x, h) + SMALL_SHARE
        ratio = ti.min(whole / plane, LARGEST_RATIO)
        slope = vec3(0.0)
        if share.x > 0.0 and ratio < LARGEST_RATIO:
            slope = share.yzw / whole - wendland_behind_slope(near.x, h) / plane * near.yzw
        missing = ti.max(1.0 - ratio, 0.0)
        larger = 1.0 + CONVEX * missing * missing
        slope *= 1.0 - 2.0 * CONVEX * ratio * missing / larger
        self.ratio[link], self.slope[link] = larger * ratio, slope

    @ti.func
    def displace(self, q: ti.template()):
        """Finds the displacements of floating bodies by multipliers q (capacity,) [m^2]; returns
        their part of <q, A q> [m^5].

        With the sums P of V_i q_i G and R of V_i q_i T over its links, a body moves by rho0 P/M and
        turns by rho0 I^-1 R.
        """
        ti.loop_config(serialize=True)
        for b in range(self.free_bodies[None]):
            self.push[b], self.twist[b] = vec3(0.0), vec3(0.0)
        ti.loop_config(serialize=self.serial)
        for link in range(self.free_links[None]):
            i, b = self.particle[link], self.body[link]
            part = self.layers.volume[self.particles.layer[i]] * q[i]
            self.push[b] += part * self.gradient[link]
            self.twist[b] += part * self.torque[link]
        product = 0.0
        ti.loop_config(serialize=True)
        for b in range(self.free_bodies[None]):
            density = self.constants.rest_density[None]
            self.moved[b] = density * self.boundary.inverse_mass[b] * self.push[b]
            self.turned[b] = density * self.boundary.inverse_inertia[b, BEGIN] @ self.twist[b]
            product += self.moved[b].dot(self.push[b]) + self.turned[b].dot(self.twist[b])
        return product

    def add_to_diagonal(self) -> None:
        """Adds the response of floating bodies to the diagonal of the pressure solve."""
        if self.boundary.floating.count:
            self._add_to_diagonal()

    @kernel
    def _add_to_diagonal(self):
        for link in range(self.free_links[None]):
            b, i, g = self.body[link], self.particle[link], self.gradient[link]
            turn = self.torque[link]
            mobility = self.boundary.inverse_mass[b] * g.norm_sqr()
            mobility += turn.dot(self.boundary.inverse_inertia[b, BEGIN] @ turn)
            self.particles.diagonal[i] += self.layers.mass[self.particles.layer[i]] * mobility

    @ti.func
    def push_at_face(self, link, impulse):
        """Adds an impulse [N s] on the body of a link, in the frame of the particle, for record();
        it acts at the foot of the perpendicular from the mirrored particle. Only the thread of the
        link's particle may call this."""
        push = self.walls.mirror_and_wall(self.mirrors[link])[0] * impulse
        foot = self.place[link] - self.distance[link] * self.normal[link]
        self.pushed[link] = self.pushed[link] + push
        self.twisted[link] = self.twisted[link] + foot.cross(push)

    def record(self, dt: float) -> None:
        """Records the impulses of a step of dt [s] on bodies: of the velocity multipliers, and
        those of push_at_face()."""
        if self.boundary.count:
            self._record(dt)

    @kernel
    def _record(self, dt: ti.f32):
        p = self.particles
        ti.loop_config(serialize=self.serial)
        for link in range(self.found[None]):
            i, b = self.particle[link], self.body[link]
            impulse = self.layers.mass[p.layer[i]] * p.velocity_multiplier[i] / dt
            push = impulse * self.gradient[link] + self.pushed[link]
            twist = impulse * self.torque[link] + self.twisted[link]
            self.impulses.body_push[b] += push
            self.impulses.body_twist[b] += twist
