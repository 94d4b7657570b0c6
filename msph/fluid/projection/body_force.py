"""Gravity, the user's hand, and the excess pressure of mirror images behind walls."""

import taichi as ti

from msph.fluid.external_forces import ExternalForces, hand_acceleration
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
        hand_position: ti.math.vec3,
        hand_velocity: ti.math.vec3,
        hand_radius: ti.f32,
        hand_grip: ti.f32,
    ):
        """Adds dt (g + hand + images' excess pressure) to v."""
        p = self.particles
        for i in range(n):
            m, x, v = self.layers.mass[p.layer[i]], p.x[i], p.v[i]
            wall = self.virial.image_acceleration(i, gravity)
            hand = hand_acceleration(x, v, dt, hand_position, hand_velocity, hand_radius, hand_grip)
            self.impulses.record_hand(m, v, dt, hand, gravity + wall)
            self.impulses.wall_impulse[None] += m * dt * wall
            p.v[i] = v + dt * (gravity + wall + hand)
