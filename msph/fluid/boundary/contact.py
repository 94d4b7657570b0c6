"""Contact of particles with walls and bodies.

Walls and bodies stop particles. Kernels are completed by images beyond walls and in bodies
(particles/images.py). Body kernels are launched only in scenes with bodies.
"""

import taichi as ti

from msph.fluid.boundary.body_shapes import END
from msph.fluid.part import Part, Parts
from msph.fluid.room import MAX_BODIES
from msph.launches import data_oriented, kernel

# Depth in a body beyond which a particle has leaked, in spacings of the finest layer. Between a
# wall and the face of a body that rests against it a particle is up to 2 NEAREST deep.
LEAK = 0.15
# Rounds in which bodies and walls push a particle out alternately. With one round up to 8 of the
# 4,104 particles of the scene `pillar` leaked, with 8 rounds none.
ROUNDS = 8
# Smallest distance to a wall, in spacings, and the golden section, whose multiples spread the
# distances of particles between this value and twice this value.
NEAREST, GOLDEN = 0.05, 0.6180340


@data_oriented
class Contact(Part):
    """Stops particles at walls and bodies. touches: number of particles that meet each body.

    Only particles with links, which were within a kernel's reach of a body at the last search, can
    meet a body: until the next search they move by less.
    """

    def __init__(self, parts: Parts):
        super().__init__(parts)
        self.touches = ti.field(ti.i32, shape=MAX_BODIES)

    def load(self) -> None:
        """Compiles the kernels that only bodies need, if there are any."""
        if self.boundary.count:
            self._meet_bodies(0)

    def drift(self, dt: float) -> None:
        """Moves particles by dt v, dt [s], and stops them at walls and at the bodies' end poses."""
        n = self.particles.count
        self._drift(n, dt)
        if self.boundary.count:
            self._meet_bodies(n)
            self.push_moving()

    def push_moving(self) -> None:
        """Hands recorded impulses to the bodies if any of them moves."""
        if self.boundary.moving:
            self.push_bodies()

    def push_bodies(self) -> None:
        """Hands the impulses recorded since the last call to the bodies."""
        if self.boundary.count:
            work = self.boundary.push(self.impulses.take_pushes(self.boundary.count))
            if work:  # access to a field takes as long as the rest
                self.impulses.wall_work.total[None] += work

    def leaked(self) -> int:
        """Returns the number of particles outside the walls, not counting those above an open top,
        or over LEAK spacings inside a body."""
        return self._count_leaked(self.particles.count, self.boundary.count > 0)

    @kernel
    def _drift(self, n: ti.i32, dt: ti.f32):
        p = self.particles
        if ti.static(self.traits.bodies):
            ti.loop_config(serialize=True)
            for b in range(MAX_BODIES):
                self.touches[b] = 0
        ti.loop_config(serialize=self.traits.light)
        for i in range(n):
            v, restitution = p.v[i], self.constants.restitution[None]
            x = p.x[i] + dt * v
            stopped = self.walls.confined(p.x[i], x, self.margin(i))
            for k in ti.static(range(3)):
                if stopped[k] != x[k]:
                    v[k] = -restitution * v[k]
            self.impulses.wall_impulse.add(i, self.layers.mass[p.layer[i]] * (v - p.v[i]))
            p.x[i], p.v[i] = stopped, v
            if ti.static(self.traits.bodies):
                if p.links[i] > 0:
                    self._count_touches(stopped, self.margin(i))

    @ti.func
    def _count_touches(self, x, margin):
        for b in range(self.constants.bodies[None]):
            if self.boundary.near(b, x, margin, END).x < margin:
                self.touches[b] += 1

    @kernel
    def _meet_bodies(self, n: ti.i32):
        """Updates velocities of particles in contact with bodies in their end poses, records the
        impulses, and moves the particles out of bodies and walls.

        A floating body of mass M that meets k particles meets each with M/k (mass splitting, Tonge
        et al. 2012): momentum is conserved, and no energy is added.
        """
        p = self.particles
        for i in range(n):
            if p.links[i] > 0:
                x, v, margin = p.x[i], p.v[i], self.margin(i)
                m = self.layers.mass[p.layer[i]]
                for b in range(self.constants.bodies[None]):
                    near = self.boundary.near(b, x, margin, END)
                    if near.x < margin:
                        push = self._rebound(b, x, v, m, near.yzw.normalized(1e-9))
                        v += push
                        self.impulses.push_body(b, -m * push, x - self.boundary.centre[b, END])
                self.impulses.wall_impulse.add(i, m * (v - p.v[i]))
                p.v[i], p.x[i] = v, self.cleared(x, margin, END)

    @ti.func
    def _rebound(self, b, x, v, m, normal):
        """Returns the change of the velocity v [m/s] of a particle of mass m [kg] at x [m] by
        contact with body b."""
        arm = x - self.boundary.centre[b, END]
        own = self.boundary.velocity[b, END] + self.boundary.spin[b, END].cross(arm)
        inward, turn = ti.min((v - own).dot(normal), 0.0), arm.cross(normal)
        mobility = turn.dot(self.boundary.inverse_inertia[b, END] @ turn)
        mobility = m * self.touches[b] * (mobility + self.boundary.inverse_mass[b])
        strength = (1.0 + self.constants.restitution[None]) / (1.0 + mobility)
        return -strength * inward * normal

    @ti.func
    def cleared(self, start, margin, pose):
        """Returns the place `start` [m] moved out of bodies and walls, to the distance `margin` [m]
        from them."""
        x, rounds = start, 0
        while rounds < ROUNDS:
            rounds += 1
            pushed = False
            for b in range(self.constants.bodies[None]):
                near = self.boundary.near(b, x, margin, pose)
                if near.x < margin:
                    x -= (near.x - margin) * near.yzw / ti.max(near.yzw.norm_sqr(), 0.25)
                    pushed = True
            # Between a body and a wall, both must push alternately.
            x = self.walls.confined(start, x, margin)
            if not pushed:
                rounds = ROUNDS
        return x

    @kernel
    def _count_leaked(self, n: ti.i32, bodies: ti.template()) -> ti.i32:
        found = 0
        for i in range(n):
            x = self.particles.x[i]
            leaked = self.apertures.beyond(x) != 0 and not self.apertures.holds(x)
            if ti.static(bodies):
                leaked |= self.boundary.clearance(x, END) < -self.constants.leak[None]
            found += ti.cast(leaked, ti.i32)
        return found

    @ti.func
    def margin(self, i):
        """Returns the distance [m] from walls at which particle i is stopped.

        It is positive, since a particle on a wall would coincide with its image, and differs
        between particles, since particles stopped at the same point would not separate.
        """
        share = GOLDEN * ti.cast(self.particles.id[i] & 1023, ti.f32)
        d = self.layers.spacing[self.particles.layer[i]]
        return NEAREST * (1.0 + share - ti.floor(share)) * d
