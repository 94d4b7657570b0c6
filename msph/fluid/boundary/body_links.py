"""Links between particles and the bodies within reach of their kernels.

Body b contributes lambda_b(x_i) to the relative density of particle i, and its mirror image in a
wall contributes lambda_b(x'), x' the mirror image of x_i. A link is one such contribution:
particle, body, mirror, and the gradient g of the contribution at x'. The particle's density changes
by (u' - U(x')).g, with u' the mirrored displacement of the particle and U the displacement of the
body; a multiplier q_i displaces the particle by -q_i g, mirrored back, and gives the body the
impulse rho0 V_i q_i g/dt at x'. The two are adjoint, and momentum is conserved (docs/method.md,
"Floating bodies").

Sums over the links of one body are taken in chunks of one body each, without atomics per link.
"""

import taichi as ti

from msph.errors import BlowUpError
from msph.fluid.boundary.body_shapes import BEGIN
from msph.fluid.boundary.boundary import Boundary
from msph.fluid.impulse_ledger import ImpulseLedger
from msph.fluid.particles.mirror_images import MirrorImages
from msph.fluid.particles.particles import Attribute, Particles
from msph.fluid.room import MAX_BODIES, Room
from msph.taichi_internals import data_oriented, kernel, longest_float

vec3 = ti.math.vec3

ATTRIBUTES = (
    Attribute(
        "boundary_share", "-", "contribution of bodies to the relative density c", carried=False
    ),
    Attribute("boundary_gradient", "1/m", "gradient of boundary_share", width=3, carried=False),
    Attribute(
        "boundary_inflow", "1/s", "rate of boundary_share by motion of bodies", carried=False
    ),
    Attribute("body_approach", "-", "compression by displaced bodies", carried=False),
)

# Links per chunk, and capacity for links per particle: a particle in a corner between two bodies
# and two walls has eight links, most particles have none.
CHUNK, LINKS_PER_PARTICLE = 64, 4

# Contributions of bodies to one particle: the product of 1 - lambda over joined bodies, the sum of
# lambda over the others (-), the gradient [1/m] and the rate by the bodies' motion [1/s].
Contributions = ti.types.struct(free=ti.f32, apart=ti.f32, gradient=vec3, inflow=ti.f32)


@data_oriented
class BodyLinks:
    """The links of the present positions, found by refresh(). Tables by link: particle, body,
    mirrors (bits), gradient [1/m]. moved [m], turned [rad]: displacements of the bodies by the
    multipliers of the last displace()."""

    def __init__(
        self,
        room: Room,
        boundary: Boundary,
        particles: Particles,
        impulses: ImpulseLedger,
    ):
        self.constants, self.layers, self.boundary = boundary.constants, boundary.layers, boundary
        self.particles, self.impulses = particles, impulses
        self.images = MirrorImages(boundary.constants)
        self.capacity = LINKS_PER_PARTICLE * room.particles
        chunks = self.capacity // CHUNK + MAX_BODIES
        self.particle, self.body, self.mirrors, self.rank = (
            ti.field(ti.i32, shape=self.capacity) for _ in range(4)
        )
        self.gradient = ti.Vector.field(3, ti.f32, shape=self.capacity)
        self.order = ti.field(ti.i32, shape=chunks * CHUNK)
        self.chunk_body, self.chunk_size = (ti.field(ti.i32, shape=chunks) for _ in range(2))
        self.found, self.chunks = ti.field(ti.i32, shape=()), ti.field(ti.i32, shape=())
        # Numbers of bodies, links and chunks that the pressure solve visits: none without floating
        # bodies.
        self.free_bodies, self.free_links, self.free_chunks = (
            ti.field(ti.i32, shape=()) for _ in range(3)
        )
        self.size, self.first = (ti.field(ti.i32, shape=MAX_BODIES) for _ in range(2))
        self.push, self.twist, self.moved, self.turned = (
            ti.Vector.field(3, ti.f32, shape=MAX_BODIES) for _ in range(4)
        )
        self.long_vector = ti.types.vector(3, longest_float())
        self.linked = 0  # number of particles that may have contributions of bodies

    def load(self) -> None:
        """Compiles the kernels that are launched later, if there are bodies; otherwise clears the
        contributions of removed bodies."""
        self.free_bodies[None] = self.free_links[None] = self.free_chunks[None] = 0
        if self.boundary.count:
            self._add_to_diagonal()
            self.found[None] = 0
            self._clear_inflow(0)
            self._add_inflow()
            self._clear(0)
        elif self.linked:
            self._clear(self.linked)
        self.linked = self.boundary.count and self.particles.x.shape[0]

    def refresh(self) -> None:
        """Finds the links, and sets the bodies' share, gradient and inflow at the particles; these
        stay 0 without bodies. Raises BlowUpError if there are more links than fit."""
        if self.boundary.count:
            self._begin()
            found = self._find_links(self.particles.count)
            if found > self.capacity:
                raise BlowUpError(
                    f"particles meet bodies in {found:,} places, at most {self.capacity:,} fit"
                )
            self._rank()
            self._sort(self.boundary.floating.count > 0)

    def refresh_inflow(self) -> None:
        """Computes the bodies' inflow anew, after their velocities changed."""
        self._clear_inflow(self.particles.count)
        self._add_inflow()

    @kernel
    def _clear(self, n: ti.i32):
        """Sets the contributions of bodies to the first n particles to 0."""
        for i in range(n):
            self.particles.boundary_share[i] = self.particles.boundary_inflow[i] = 0.0
            self.particles.boundary_gradient[i] = vec3(0.0)
            self.particles.body_approach[i] = 0.0

    @kernel
    def _clear_inflow(self, n: ti.i32):
        for i in range(n):
            self.particles.boundary_inflow[i] = 0.0

    @kernel
    def _add_inflow(self):
        for link in range(self.found[None]):
            mirror, wall = self.images.mirror_and_wall(self.mirrors[link])
            i, b = self.particle[link], self.body[link]
            x = self.images.reflected(self.particles.x[i], mirror, wall)
            velocity = self.boundary.velocity_at(b, x)
            self.particles.boundary_inflow[i] -= velocity.dot(self.gradient[link])

    @kernel
    def _begin(self):
        self.found[None] = 0
        for b in range(MAX_BODIES):
            self.size[b] = 0

    @kernel
    def _find_links(self, n: ti.i32) -> ti.i32:
        """Finds the links; returns their number, of which the first `capacity` are stored."""
        p = self.particles
        for i in range(n):
            x, h = p.x[i], self.boundary.support[p.layer[i]]
            total = Contributions(free=1.0)
            near = self.images.walls_near(x, h) & self._mirroring_walls()
            combinations = self.images.combinations(near)
            count = 0
            for number in range(combinations):
                count += self._count(i, self.images.combination(number, near), h)
            # Outside the loops, in which Mesa's software driver loses atomic operations.
            link = ti.atomic_add(self.found[None], count)
            for number in range(combinations):
                self._add(i, self.images.combination(number, near), h, total, link)
            per_yield = self.layers.per_yield[p.layer[i]]
            p.boundary_share[i] = per_yield * (1.0 - total.free + total.apart)
            p.boundary_gradient[i], p.boundary_inflow[i] = total.gradient, total.inflow
        return self.found[None]

    @ti.func
    def _mirroring_walls(self):
        """Returns the walls that mirror a body, as bits."""
        found = 0
        for b in range(self.constants.bodies[None]):
            found |= self.boundary.images[b, BEGIN]
        return found

    @ti.func
    def _reaches(self, b, x, mirrors, h):
        """Returns False if body b is certainly farther than h [m] from the position x [m] mirrored
        by `mirrors`, or is not mirrored by these walls."""
        mirrored = (self.boundary.images[b, BEGIN] & mirrors) == mirrors
        return mirrored and self.boundary.reaches(b, x, h, BEGIN)

    @ti.func
    def _links(self, b, x, layer, h):
        """Returns True if body b within reach of x [m] has a gradient there: a link."""
        return self.boundary.meets_kernel(b, self.boundary.to_body_frame(b, x, BEGIN), layer, h)

    @ti.func
    def _count(self, i, mirrors, h):
        """Returns the number of links that _add() stores."""
        mirror, wall = self.images.mirror_and_wall(mirrors)
        x, found = self.images.reflected(self.particles.x[i], mirror, wall), 0
        for b in range(self.constants.bodies[None]):
            if self._reaches(b, x, mirrors, h) and self._links(b, x, self.particles.layer[i], h):
                found += 1
        return found

    @ti.func
    def _add(self, i, mirrors, h, total: ti.template(), link: ti.template()):
        """Adds the contributions of all bodies, or of their images by `mirrors`, to particle i;
        stores links from index `link` on and advances `link`."""
        layer = self.particles.layer[i]
        per_yield = self.layers.per_yield[layer]
        mirror, wall = self.images.mirror_and_wall(mirrors)
        x = self.images.reflected(self.particles.x[i], mirror, wall)
        for b in range(self.constants.bodies[None]):
            if self._reaches(b, x, mirrors, h):
                part = self.boundary.body_share(b, x, layer, h, BEGIN)
                g = per_yield * part.yzw
                if mirrors == 0 and self.boundary.joined[b] == 1:
                    total.free *= 1.0 - part.x
                    g *= self.boundary.free_of_others(b, x, layer, h)
                else:
                    total.apart += part.x
                total.gradient += mirror * g
                total.inflow -= self.boundary.velocity_at(b, x).dot(g)
                if self._links(b, x, layer, h):
                    if link < self.capacity:
                        self.particle[link], self.body[link] = i, b
                        self.mirrors[link], self.gradient[link] = mirrors, g
                    link += 1

    @kernel
    def _rank(self):
        """Numbers the links of each body."""
        for link in range(self.found[None]):
            self.rank[link] = ti.atomic_add(self.size[self.body[link]], 1)

    @kernel
    def _sort(self, floating: ti.i32):
        """Distributes the links of each body over chunks."""
        chunks = 0
        ti.loop_config(serialize=True)
        for b in range(self.constants.bodies[None]):
            self.first[b] = chunks
            for k in range((self.size[b] + CHUNK - 1) // CHUNK):
                self.chunk_body[chunks] = b
                self.chunk_size[chunks] = ti.min(CHUNK, self.size[b] - k * CHUNK)
                chunks += 1
        self.chunks[None] = chunks
        self.free_bodies[None] = floating * self.constants.bodies[None]
        self.free_chunks[None] = floating * chunks
        self.free_links[None] = floating * self.found[None]
        for link in range(self.found[None]):
            self.order[self.first[self.body[link]] * CHUNK + self.rank[link]] = link

    @ti.func
    def image(self, link):
        """Returns a link's mirror, body, and the mirrored position of the particle relative to the
        body's centre [m]."""
        mirror, wall = self.images.mirror_and_wall(self.mirrors[link])
        b, x = self.body[link], self.particles.x[self.particle[link]]
        return mirror, b, self.images.reflected(x, mirror, wall) - self.boundary.centre[b, BEGIN]

    @ti.func
    def _arm(self, link):
        """Returns the mirrored position of a link's particle relative to the body's centre [m]."""
        return self.image(link)[2]

    @ti.func
    def displace(self, q: ti.template()):
        """Finds the displacements of floating bodies by multipliers q (capacity,) [m^2], and
        `body_approach` of particles, which must be 0; returns their part of <q, A q> [m^5].

        With the sums S of V_i q_i g and T of r x V_i q_i g over its links, a body moves by rho0 S/M
        and turns by rho0 I^-1 T.
        """
        ti.loop_config(serialize=True)
        for b in range(self.free_bodies[None]):
            self.push[b], self.twist[b] = vec3(0.0), vec3(0.0)
        for chunk in range(self.free_chunks[None]):
            push, twist = vec3(0.0), vec3(0.0)
            for k in range(self.chunk_size[chunk]):
                link = self.order[chunk * CHUNK + k]
                i = self.particle[link]
                part = self.layers.volume[self.particles.layer[i]] * q[i] * self.gradient[link]
                push += part
                twist += self._arm(link).cross(part)
            self.push[self.chunk_body[chunk]] += push
            self.twist[self.chunk_body[chunk]] += twist
        product = 0.0
        ti.loop_config(serialize=True)
        for b in range(self.free_bodies[None]):
            density = self.constants.rest_density[None]
            self.moved[b] = density * self.boundary.inverse_mass[b] * self.push[b]
            self.turned[b] = density * self.boundary.inverse_inertia[b, BEGIN] @ self.twist[b]
            product += self.moved[b].dot(self.push[b]) + self.turned[b].dot(self.twist[b])
        for link in range(self.free_links[None]):
            b = self.body[link]
            way = self.moved[b] + self.turned[b].cross(self._arm(link))
            self.particles.body_approach[self.particle[link]] -= way.dot(self.gradient[link])
        return product

    def add_to_diagonal(self) -> None:
        """Adds the response of floating bodies to the diagonal of the pressure solve."""
        if self.boundary.floating.count:
            self._add_to_diagonal()

    @kernel
    def _add_to_diagonal(self):
        for link in range(self.free_links[None]):
            b, i, g = self.body[link], self.particle[link], self.gradient[link]
            turn = self._arm(link).cross(g)
            mobility = self.boundary.inverse_mass[b] * g.norm_sqr()
            mobility += turn.dot(self.boundary.inverse_inertia[b, BEGIN] @ turn)
            self.particles.diagonal[i] += self.layers.mass[self.particles.layer[i]] * mobility

    def record_pressure(self, dt: float) -> None:
        """Records the impulses of the velocity multipliers in a step of dt [s] on all bodies."""
        if self.boundary.count:
            self._record_pressure(dt)

    @kernel
    def _record_pressure(self, dt: ti.f32):
        p = self.particles
        for chunk in range(self.chunks[None]):
            push, twist = self.long_vector(0.0), self.long_vector(0.0)
            for k in range(self.chunk_size[chunk]):
                link = self.order[chunk * CHUNK + k]
                i = self.particle[link]
                share = self.layers.mass[p.layer[i]] * p.velocity_multiplier[i] / dt
                part = share * self.gradient[link]
                push += part
                twist += self._arm(link).cross(part)
            self.impulses.body_push[self.chunk_body[chunk]] += push
            self.impulses.body_twist[self.chunk_body[chunk]] += twist
