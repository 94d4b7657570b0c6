"""Impulses and work that act on the water, summed as a solver's steps go, by their cause."""

import taichi as ti

from msph.taichi_internals import data_oriented, kernel, longest_float


@data_oriented
class ImpulseLedger:
    """Sums since the reset, fields of shape () that a solver's kernels add to.

    internal_impulse [N s] and internal_angular_impulse [N m s], about the origin: of pair forces
    and of position corrections at constant velocity; zero for an exact method.
    wall_impulse [N s], wall_work [J]: of walls and bodies; walls at rest do no work.
    body_impulse [N s]: the part of wall_impulse that is of bodies.
    user_impulse [N s], user_work [J]: of the hand.
    merge_loss [J]: kinetic energy that merges dissipated.

    Double precision where the device sums it: in single precision the sums of still water drifted
    by 2.6e-5 of its largest sum m |v| within 2 s, of which 1.2e-6 were the water's.
    """

    def __init__(self):
        number = longest_float()
        self.internal_impulse = ti.Vector.field(3, number, shape=())
        self.internal_angular_impulse = ti.Vector.field(3, number, shape=())
        self.wall_impulse = ti.Vector.field(3, number, shape=())
        self.body_impulse = ti.Vector.field(3, number, shape=())
        self.wall_work = ti.field(number, shape=())
        self.user_impulse = ti.Vector.field(3, number, shape=())
        self.user_work = ti.field(number, shape=())
        self.merge_loss = ti.field(number, shape=())

    @kernel
    def clear(self):
        """Back to zero."""
        for vector in ti.static(
            (
                self.internal_impulse,
                self.internal_angular_impulse,
                self.wall_impulse,
                self.body_impulse,
                self.user_impulse,
            )
        ):
            vector[None] = ti.Vector([0.0, 0.0, 0.0])
        for scalar in ti.static((self.wall_work, self.user_work, self.merge_loss)):
            scalar[None] = 0.0

    @ti.func
    def record_internal(self, m, x, dv):
        """Adds the impulse of pair forces that changed the velocity of mass m [kg] at x [m] by
        dv [m/s]."""
        self.internal_impulse[None] += m * dv
        self.internal_angular_impulse[None] += m * x.cross(dv)

    @ti.func
    def record_hand(self, m, v, dt, hand, others):
        """Adds impulse m dt a and work, at the mean velocity, of the hand in a step of dt [s].

        v [m/s] before the step, accelerations [m/s^2] of the hand and of all other forces.
        """
        self.user_impulse[None] += m * dt * hand
        self.user_work[None] += m * dt * hand.dot(v + 0.5 * dt * (hand + others))
