"""Gravity, inertia of a moving box, the user's hand, and the excess pressure of mirror images."""

import taichi as ti

from msph.fluid.external_forces import (
    FIELD_NUMBERS,
    HAND_NUMBERS,
    ExternalForces,
    coriolis,
    field_at,
    hand_acceleration,
    turning,
)
from msph.fluid.projection.force import Force
from msph.launches import data_oriented, kernel


@data_oriented
class BodyForce(Force):
    """Force that accelerates all particles by the external forces."""

    def apply(self, dt: float, external: ExternalForces) -> None:
        numbers = external.field(), external.hand.numbers()
        self._accelerate(self.particles.count, dt, *numbers)

    @kernel
    def _accelerate(
        self, n: ti.i32, dt: ti.f32, field_numbers: FIELD_NUMBERS, hand_numbers: HAND_NUMBERS
    ):
        """Adds dt (g + inertia + hand + images' excess pressure) to v."""
        p, centre = self.particles, 0.5 * self.constants.size[None]
        for i in range(n):
            m, x, v = self.layers.mass[p.layer[i]], p.x[i], p.v[i]
            field = field_at(x - centre, field_numbers)
            wall = self.virial.image_acceleration(i, dt, field)
            field += coriolis(v, dt, turning(field_numbers))
            user = hand_acceleration(x, v, dt, hand_numbers)
            self.impulses.record_user(i, m, v, dt, user, field + wall)
            self.impulses.wall_impulse.add(i, m * dt * wall)
            p.v[i] = v + dt * (field + wall + user)
