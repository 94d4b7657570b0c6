"""Impulse and work that act on the water, summed over the steps, by cause."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import taichi as ti

from msph.fluid.room import MAX_BODIES
from msph.fluid.sums import SLOTS, Sum
from msph.host_memory import memory_of
from msph.launches import data_oriented, small_kernel
from msph.taichi_internals import longest_float, on_cpu


@data_oriented
class ImpulseLedger:
    """Sums of impulse and work since the reset, to which the solvers' kernels add.

    internal_impulse [N s] and internal_angular_impulse [N m s], about the origin: of pair forces
    and of position corrections at constant velocity; zero for an exact method. wall_impulse [N s],
    wall_work [J]: of walls and bodies; walls at rest and floating bodies do no work. user_impulse
    [N s], user_work [J]: of the hand, of added water and bodies, and of dragged bodies.
    inertia_impulse [N s], inertia_work [J]: of the inertial forces of a moving box on the water.
    added_mass [kg]: of water added by the user. merge_loss [J]: kinetic energy dissipated by
    merges. spilt_momentum [N s], spilt_energy [J]: of the water that left an open box, when it
    left; outflow_momentum, outflow_energy: of the water that left through outflows. inflow_mass
    [kg], inflow_impulse [N s], inflow_work [J]: of the water that inflows add, and by prescribed
    velocities. body_push [N s], body_twist [N m s], by body: impulses and angular impulses, about
    the body's centre, of the water on a body since take_pushes().
    """

    def __init__(self):
        number = longest_float()
        self.internal_impulse = Sum(vector=True)
        self.internal_angular_impulse = Sum(vector=True)
        self.wall_impulse, self.wall_work = Sum(vector=True), Sum()
        self.user_impulse, self.user_work = Sum(vector=True), Sum()
        self.inertia_impulse, self.inertia_work = Sum(vector=True), Sum()
        self.added_mass, self.merge_loss = Sum(), Sum()
        self.spilt_momentum, self.spilt_energy = Sum(vector=True), Sum()
        self.outflow_momentum, self.outflow_energy = Sum(vector=True), Sum()
        self.inflow_mass = Sum()
        self.inflow_impulse, self.inflow_work = Sum(vector=True), Sum()
        self.sums = tuple(v for v in vars(self).values() if isinstance(v, Sum))
        self.body_push = ti.Vector.field(3, number, shape=MAX_BODIES)
        self.body_twist = ti.Vector.field(3, number, shape=MAX_BODIES)

    def clear(self) -> None:
        """Sets all sums to zero."""
        self._clear()
        self.body_push.fill(0.0)
        self.body_twist.fill(0.0)

    def gather(self) -> None:
        """Completes the totals of all sums."""
        if not on_cpu():
            self._gather()

    def totals(self) -> list[Any]:
        """Returns the totals of all sums."""
        self.gather()
        memories = [memory_of(each.total) for each in self.sums]
        if all(memories):  # to_numpy() takes 15 us
            return [np.squeeze(memory.array()).copy() for memory in memories]
        return [each.total.to_numpy() for each in self.sums]

    def restore(self, totals: list[Any]) -> None:
        """Restores totals()."""
        self.clear()
        for each, total in zip(self.sums, totals, strict=True):
            each.total.from_numpy(total)

    @small_kernel
    def _gather(self):
        for slot in range(SLOTS):
            for each in ti.static(self.sums):
                each.gather(slot)

    @small_kernel
    def _clear(self):
        for each in ti.static(self.sums):
            each.total[None] = 0
        for slot in range(SLOTS):
            for each in ti.static(self.sums):
                each.parts[slot] = 0

    def take_pushes(self, bodies: int) -> np.ndarray:
        """Returns body_push and body_twist, (bodies, 6), and sets them to zero."""
        memories = memory_of(self.body_push), memory_of(self.body_twist)
        if all(memories):
            rows = [memory.array()[:bodies] for memory in memories]
            taken = np.concatenate(rows, axis=1)
            for row in rows:
                row[...] = 0.0
            return taken
        pushes = np.zeros((bodies, 6), np.float64 if longest_float() == ti.f64 else np.float32)
        self._take_pushes(pushes)
        return pushes.astype(float, copy=False)

    @small_kernel
    def _take_pushes(self, pushes: ti.types.ndarray(ndim=2)):
        for b in range(pushes.shape[0]):
            for k in ti.static(range(3)):
                pushes[b, k], pushes[b, 3 + k] = self.body_push[b][k], self.body_twist[b][k]
            self.body_push[b] *= 0.0
            self.body_twist[b] *= 0.0

    @ti.func
    def push_body(self, b, impulse, arm):
        """Adds an impulse [N s] of the water on body b at `arm` [m] from its centre."""
        self.body_push[b] += impulse
        self.body_twist[b] += arm.cross(impulse)

    def add_water(self, m: float, x: np.ndarray, v: np.ndarray, gravity: np.ndarray) -> None:
        """Records particles of m [kg] each, added at x [m] with v [m/s], (n, 3): their mass,
        momentum and energy."""
        self._add_water(m, x, v, gravity, (self.added_mass, self.user_impulse, self.user_work))

    def add_inflow(self, m: float, x: np.ndarray, v: np.ndarray, gravity: np.ndarray) -> None:
        """Records particles that an inflow adds, as add_water() does."""
        sums = self.inflow_mass, self.inflow_impulse, self.inflow_work
        self._add_water(m, x, v, gravity, sums)

    @staticmethod
    def _add_water(m: float, x: np.ndarray, v: np.ndarray, gravity: np.ndarray, sums: Any) -> None:
        x, v = x.astype(float), v.astype(float)
        mass, impulse, work = sums
        mass.total[None] += m * len(x)
        impulse.total[None] += ti.Vector((m * v.sum(axis=0)).tolist())
        work.total[None] += m * float(0.5 * (v**2).sum() - (x @ gravity).sum())

    def add_user(self, impulse: Sequence[float] | np.ndarray, work: float) -> None:
        """Records an impulse [N s] and work [J] of the user on floating bodies."""
        self.user_impulse.total[None] += ti.Vector(list(impulse))
        self.user_work.total[None] += work

    @ti.func
    def record_internal(self, i, m, x, dv):
        """Adds the impulse of pair forces that changed the velocity of particle i, m [kg] at x, by
        dv [m/s]."""
        self.internal_impulse.add(i, m * dv)
        self.internal_angular_impulse.add(i, m * x.cross(dv))

    @ti.func
    def record_user(self, i, m, v, dt, user, others):
        """Adds the user's impulse m dt `user` on particle i, and its work at the mean velocity, in
        a step of dt [s].

        v [m/s] before the step; user, others [m/s^2]: accelerations by the user and by all other
        forces.
        """
        self.user_impulse.add(i, m * dt * user)
        self.user_work.add(i, m * dt * user.dot(v + 0.5 * dt * (user + others)))
