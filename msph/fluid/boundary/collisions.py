"""Contact of floating bodies with walls and other bodies: sequential impulses (Catto 2005).

Points on the surface of a body (a ball's centre, with its radius) are compared with the walls and
the signed distances of the other bodies. A contact is a point whose gap may close within a step.
Each iteration visits the contacts in turn and corrects their impulses: the normal impulse is at
least 0, friction at most its coefficient times the normal impulse. A contact with an open gap
allows the approach that closes the gap (speculative contact). Penetrations are removed by
displacements that add no velocity.

The water's pressure and the contacts are solved one after the other. The first solve for the
contacts predicts the impulses of the water by those of the last step, so that the weight of a body
at rest on the floor is shared between floor and water.
"""

import math
from functools import lru_cache

import numpy as np
import taichi as ti

from msph.errors import BlowUpError
from msph.fluid.boundary.body_shapes import BALL, BEGIN
from msph.fluid.boundary.rigid_bodies import Ball, Block, Body, Solid, centre, half_extents
from msph.fluid.boundary.walls import NO_WALL, WALL, WALLS
from msph.fluid.part import Part, Parts
from msph.fluid.room import MAX_BODIES
from msph.fluid.small_numbers import MIN_DIVISOR
from msph.launches import data_oriented, kernel, small_kernel

vec3 = ti.math.vec3

# Largest number of points on a mesh, and points along the edge of a block.
MAX_POINTS, EDGE_POINTS = 200, 4
# Largest number of contacts.
MAX_CONTACTS = 4096
# Iterations over all contacts: 20 boxes in a heap rest after 20.
ITERATIONS = 20
# Depth of penetration that remains, so that contacts last, in finest spacings; and the share (-) of
# the depth beyond it that a step removes.
SLOP, REMOVED = 0.01, 0.3
# Approach within a step, in slops, below which nothing rebounds.
LEAST_REBOUND = 20.0

NUMBERS = ti.types.ndarray(dtype=ti.f32, ndim=2)


@data_oriented
class Collisions(Part):
    """Contacts of the present step. Tables by contact: first and second body (WALL for a wall),
    place [m], normal towards the first body, gap [m], friction (-), and the impulse so far. Motions
    (MAX_BODIES + 1, 6) are velocities [m/s] and spins [rad/s], or displacements [m] and angles
    [rad]."""

    def __init__(self, parts: Parts):
        super().__init__(parts)
        points = MAX_BODIES * MAX_POINTS
        self.point_body = ti.field(ti.i32, shape=points)
        self.point = ti.Vector.field(3, ti.f32, shape=points)
        self.found = ti.field(ti.i32, shape=())
        self.first, self.second = (ti.field(ti.i32, shape=MAX_CONTACTS) for _ in range(2))
        self.place, self.normal, self.impulse = (
            ti.Vector.field(3, ti.f32, shape=MAX_CONTACTS) for _ in range(3)
        )
        self.gap, self.target, self.friction = (
            ti.field(ti.f32, shape=MAX_CONTACTS) for _ in range(3)
        )
        self.count = self.points = 0

    def load(self) -> None:
        """Takes the points of the boundary's present bodies; compiles all kernels."""
        self.points = self.count = 0
        if not self.boundary.count:
            return
        clouds = [contact_points(body) for body in self.boundary.bodies]
        self.points = sum(len(c) for c in clouds)
        owner = np.repeat(np.arange(len(clouds)), [len(c) for c in clouds])
        self._store(np.concatenate(clouds).astype(np.float32), owner.astype(np.int32))
        motions = self._motions()
        self._find_contacts(0, 0.0)
        self._prepare(0, 1.0, 0.0, motions)
        self._solve(0, 0, motions)
        self._separate(0, 0, 0.0, motions)

    @kernel
    def _store(self, points: NUMBERS, owner: ti.types.ndarray(dtype=ti.i32, ndim=1)):
        for k in range(points.shape[0]):
            self.point[k] = vec3(points[k, 0], points[k, 1], points[k, 2])
            self.point_body[k] = owner[k]

    def anticipate(self, dt: float) -> None:
        """Finds the contacts of a step of dt [s] at the beginning of its second half, and applies
        their impulses for the forces of the water that acted in the last step. Raises BlowUpError
        if there are more contacts than fit."""
        boundary, floating = self.boundary, self.boundary.floating
        if not floating.count:
            return
        expected = floating.expected(dt)
        slop = SLOP * self.layers.finest.spacing
        reach = 2.0 * dt * boundary.top_speed + slop
        self.count = self._find_contacts(self.points, reach)
        if self.count > MAX_CONTACTS:
            raise BlowUpError(
                f"bodies touch in {self.count:,} places, at most {MAX_CONTACTS:,} are possible"
            )
        if not self.count:
            return
        deepest = self._prepare(self.count, dt, slop, self._motions())
        if deepest < -slop:
            shifts = np.zeros((MAX_BODIES + 1, 6), np.float32)
            self._separate(self.count, ITERATIONS, slop, shifts)
            floating.shift(shifts[floating.which].astype(float))
            boundary.redo(0.5 * dt)
        floating.push(expected[:, :3], expected[:, 3:])
        self.resolve()
        floating.push(-expected[:, :3], -expected[:, 3:])

    def resolve(self) -> None:
        """Applies the impulses of the contacts to the present velocities."""
        if self.count:
            motions = self._motions()
            before = motions.copy()
            self._solve(self.count, ITERATIONS, motions)
            self.boundary.floating.change(
                (motions - before)[self.boundary.floating.which].astype(float)
            )

    def _motions(self) -> np.ndarray:
        """Returns the present velocities and spins of all bodies, and of the walls."""
        found = np.zeros((MAX_BODIES + 1, 6), np.float32)
        found[: self.boundary.count] = self.boundary.motions()
        return found

    @small_kernel
    def _find_contacts(self, points: ti.i32, reach: ti.f32) -> ti.i32:
        """Finds the contacts of gaps below `reach` [m]; returns their number."""
        self.found[None] = 0
        for k in range(points):
            a = self.point_body[k]
            x = self.boundary.centre[a, BEGIN] + self.boundary.rotation[a, BEGIN] @ self.point[k]
            radius = ti.select(self.boundary.kind[a] == BALL, self.boundary.half[a][0], 0.0)
            for b in range(-WALLS, self.constants.bodies[None]):
                if self._may_meet(a, b):
                    near = self.boundary.near(b, x, NO_WALL, BEGIN)
                    normal = near.yzw.normalized(1e-9)
                    if near.x - radius < reach:
                        second = ti.select(b < 0, WALL, b)
                        self._append(a, second, x - radius * normal, normal, near.x - radius)
        return self.found[None]

    @ti.func
    def _may_meet(self, a, b):
        """Returns True if the points of body a are to be compared with body b or, if negative, a
        wall: one of them floats, and b is no ball, whose centre is compared instead, or the later
        of two balls."""
        found = self.boundary.inverse_mass[a] > 0.0
        if b >= 0:
            mobile = found or self.boundary.inverse_mass[b] > 0.0
            ball = self.boundary.kind[b] == BALL
            if self.boundary.kind[a] == BALL:
                ball = ball and b < a
            reach = self.boundary.bounding_radius[a] + self.boundary.bounding_radius[b]
            apart = self.boundary.centre[a, BEGIN] - self.boundary.centre[b, BEGIN]
            close = self.boundary.side[b] < 0.0 or apart.norm() < 1.5 * reach
            found = a != b and mobile and not ball and close and self.boundary.side[a] > 0.0
        return found

    @ti.func
    def _append(self, a, b, place, normal, gap):
        c = ti.atomic_add(self.found[None], 1)
        if c < MAX_CONTACTS:
            self.first[c], self.second[c], self.gap[c] = a, b, gap
            self.place[c], self.normal[c] = place, normal

    @small_kernel
    def _prepare(self, count: ti.i32, dt: ti.f32, slop: ti.f32, motions: NUMBERS) -> ti.f32:
        """Sets the least normal velocity of each contact, the impulse 0 and the friction; returns
        the smallest gap [m]."""
        deepest = 0.0
        for c in range(count):
            approach = self._relative(c, motions).dot(self.normal[c])
            rebound = -1e9
            if approach * dt < -ti.max(LEAST_REBOUND * slop, self.gap[c]):
                rebound = -self.constants.restitution[None] * approach
            # An open gap may close within the step; a body that rebounds does so now.
            self.target[c] = ti.max(-ti.max(self.gap[c], 0.0) / dt, rebound)
            self.impulse[c] = vec3(0.0)
            mu = self.boundary.friction[self.first[c]]
            if self.second[c] != WALL:
                mu = ti.sqrt(mu * self.boundary.friction[self.second[c]])
            self.friction[c] = mu
            ti.atomic_min(deepest, self.gap[c])
        return deepest

    @kernel
    def _solve(self, count: ti.i32, iterations: ti.i32, motions: NUMBERS):
        """Changes the motions by impulses of the contacts, accumulated over calls."""
        ti.loop_config(serialize=True)
        for step in range(2 * count * iterations):
            c = step % count
            if self._is_due(c, step, count * iterations):
                n, old = self.normal[c], self.impulse[c]
                v = self._relative(c, motions)
                along = old.dot(n)
                normal = ti.max(along + (self.target[c] - v.dot(n)) / self._mobility(c, n), 0.0)
                slip = v - v.dot(n) * n
                sideways = old - along * n
                speed = slip.norm()
                if speed > 0.0:
                    sideways -= slip / self._mobility(c, slip / speed)
                most = self.friction[c] * normal
                sideways *= ti.min(1.0, most / ti.max(sideways.norm(), MIN_DIVISOR))
                self.impulse[c] = normal * n + sideways
                self._apply(c, self.impulse[c] - old, motions)

    @ti.func
    def _is_due(self, c, step, iterated):
        """Returns True if a step of an iteration over contacts visits contact c: all contacts in
        the first `iterated` steps, those with walls in the others. So a body that is squeezed
        between a wall and a body in prescribed motion does not pass the wall."""
        return step < iterated or self.second[c] == WALL

    @kernel
    def _separate(self, count: ti.i32, iterations: ti.i32, slop: ti.f32, shifts: NUMBERS):
        """Finds displacements that remove a share of the penetrations deeper than `slop` [m]."""
        ti.loop_config(serialize=True)
        for step in range(2 * count * iterations):
            c = step % count
            n = self.normal[c]
            way = -REMOVED * ti.min(self.gap[c] + slop, 0.0) - self._relative(c, shifts).dot(n)
            if self._is_due(c, step, count * iterations) and self.gap[c] < -slop and way > 0.0:
                self._apply(c, way / self._mobility(c, n) * n, shifts)

    @ti.func
    def _relative(self, c, motions: ti.template()):
        """Returns the motion of the first body's point relative to the second's."""
        first = self._motion_at(self.first[c], self.place[c], motions)
        return first - self._motion_at(self.second[c], self.place[c], motions)

    @ti.func
    def _motion_at(self, b, x, motions: ti.template()):
        v = vec3(motions[b, 0], motions[b, 1], motions[b, 2])
        w = vec3(motions[b, 3], motions[b, 4], motions[b, 5])
        return v + w.cross(x - self.boundary.centre[b, BEGIN])

    @ti.func
    def _mobility(self, c, direction):
        """Returns the change of relative velocity along a direction by a unit impulse [1/kg]."""
        first = self._own_mobility(self.first[c], self.place[c], direction)
        return first + self._own_mobility(self.second[c], self.place[c], direction)

    @ti.func
    def _own_mobility(self, b, x, direction):
        turn = (x - self.boundary.centre[b, BEGIN]).cross(direction)
        turning = turn.dot(self.boundary.inverse_inertia[b, BEGIN] @ turn)
        return self.boundary.inverse_mass[b] + turning

    @ti.func
    def _apply(self, c, impulse, motions: ti.template()):
        self._push(self.first[c], self.place[c], impulse, motions)
        self._push(self.second[c], self.place[c], -impulse, motions)

    @ti.func
    def _push(self, b, x, impulse, motions: ti.template()):
        v = self.boundary.inverse_mass[b] * impulse
        arm = x - self.boundary.centre[b, BEGIN]
        w = self.boundary.inverse_inertia[b, BEGIN] @ arm.cross(impulse)
        for k in ti.static(range(3)):
            motions[b, k] += v[k]
            motions[b, 3 + k] += w[k]


@lru_cache(MAX_BODIES)
def contact_points(body: Body) -> np.ndarray:
    """Returns the points (n, 3) [m] of a body, in its frame, that may touch other bodies."""
    if isinstance(body, Ball):
        return np.zeros((1, 3))
    if isinstance(body, Block):
        axis = np.linspace(-1.0, 1.0, EDGE_POINTS + 1)
        grid = np.stack(np.meshgrid(axis, axis, axis), axis=-1).reshape(-1, 3)
        return grid[np.abs(grid).max(axis=1) == 1.0] * half_extents(body)
    assert isinstance(body, Solid)
    corners = body.vertices[body.triangles]
    points = np.concatenate([body.vertices, corners.mean(axis=1)]) - centre(body)
    return spread(points, MAX_POINTS)


def spread(points: np.ndarray, most: int) -> np.ndarray:
    """Returns at most `most` of the points (n, 3), each as far as possible from those before."""
    if len(points) <= most:
        return points
    chosen = [int(np.argmax(np.linalg.norm(points, axis=1)))]
    distance = np.full(len(points), math.inf)
    while len(chosen) < most:
        distance = np.minimum(distance, np.linalg.norm(points - points[chosen[-1]], axis=1))
        chosen.append(int(np.argmax(distance)))
    return points[chosen]
