"""Gravity, the user's hand and tilt, and the excess pressure of mirror images behind walls."""

import taichi as ti

from msph.fluid.external_forces import (
    HAND_NUMBERS,
    TURN_NUMBERS,
    ExternalForces,
    coriolis,
    field_in_turning_box,
    hand_acceleration,
)
from msph.fluid.projection.discretisation import Discretisation
from msph.fluid.projection.force import Force
from msph.fluid.projection.virial_pressure import VirialPressure
from msph.taichi_internals import data_oriented, kernel


@data_oriented
class BodyForce(Force):
    """Force that accelerates all particles by the external forces."""

    def __init__(self, shared: Discretisation):
        super().__init__(shared)
        self.virial = VirialPressure(shared, shared.density)

    def apply(self, dt: float, external: ExternalForces) -> None:
        self._accelerate(self.particles.count, dt, *external.arguments())

    @kernel
    def _accelerate(
        self,
        n: ti.i32,
        dt: ti.f32,
        gravity: ti.math.vec3,
        hand_numbers: HAND_NUMBERS,
        turn: TURN_NUMBERS,
    ):
        """Adds dt (g + rotation + hand + images' excess pressure) to v."""
        p, centre = self.particles, 0.5 * self.constants.size[None]
        for i in range(n):
            m, x, v = self.layers.mass[p.layer[i]], p.x[i], p.v[i]
            field = field_in_turning_box(x - centre, turn)
            wall = self.virial.image_acceleration(i, gravity + field)
            user = field + coriolis(v, dt, turn) + hand_acceleration(x, v, dt, hand_numbers)
            self.impulses.record_user(i, m, v, dt, user, gravity + wall)
            self.impulses.wall_impulse.add(i, m * dt * wall)
            p.v[i] = v + dt * (gravity + wall + user)
