"""What a solver writes down as it goes: impulses and work, by who gave them."""

import taichi as ti

from msph.launch import data_oriented, kernel


@data_oriented
class Accounts:
    """Sums since the reset, fields of shape () that a solver's kernels add to.

    internal_impulse [N s] and internal_angular_impulse [N m s], about the origin: what pair forces
    gave, and the shift of particles that kept their velocity; zero for an exact method.
    wall_impulse [N s], wall_work [J]: what walls gave; walls that stand still do no work.
    user_impulse [N s], user_work [J]: what the hand gave.
    merge_loss [J]: kinetic energy that merges of particles took.

    Single precision: the impulses of a long run are good to about 1e-5 of all that was exchanged.
    """

    def __init__(self):
        self.internal_impulse = ti.Vector.field(3, ti.f32, shape=())
        self.internal_angular_impulse = ti.Vector.field(3, ti.f32, shape=())
        self.wall_impulse = ti.Vector.field(3, ti.f32, shape=())
        self.wall_work = ti.field(ti.f32, shape=())
        self.user_impulse = ti.Vector.field(3, ti.f32, shape=())
        self.user_work = ti.field(ti.f32, shape=())
        self.merge_loss = ti.field(ti.f32, shape=())

    @kernel
    def clear_accounts(self):
        """Back to zero."""
        for vector in ti.static(
            (
                self.internal_impulse,
                self.internal_angular_impulse,
                self.wall_impulse,
                self.user_impulse,
            )
        ):
            vector[None] = ti.Vector([0.0, 0.0, 0.0])
        for scalar in ti.static((self.wall_work, self.user_work, self.merge_loss)):
            scalar[None] = 0.0

    @ti.func
    def book_internal(self, m, x, dv):
        """Enters what other particles changed of the velocity of one of mass m [kg] at x [m]."""
        self.internal_impulse[None] += m * dv
        self.internal_angular_impulse[None] += m * x.cross(dv)

    @ti.func
    def book_hand(self, m, v, dt, hand, others):
        """Enters what the hand gives in a step: impulse m dt a, work by the mean velocity.

        v [m/s] before the step, accelerations [m/s^2] of the hand and of all else acting with it.
        """
        self.user_impulse[None] += m * dt * hand
        self.user_work[None] += m * dt * hand.dot(v + 0.5 * dt * (hand + others))
