"""Gravity, the user's hand, and the excess pressure of mirror images behind walls."""

import math

import taichi as ti

from msph.fluid.external_forces import ExternalForces, hand_acceleration
from msph.fluid.particles.particles import Attribute
from msph.fluid.projection.discretisation import Discretisation
from msph.fluid.projection.parameters import ProjectionParameters
from msph.fluid.projection.virial_pressure import VirialPressure
from msph.taichi_internals import data_oriented, kernel


@data_oriented
class BodyForce:
    """Force that accelerates all particles by the external forces."""

    ATTRIBUTES: tuple[Attribute, ...] = ()

    @staticmethod
    def enabled(parameters: ProjectionParameters) -> bool:
        return True

    def __init__(self, shared: Discretisation):
        self.layers, self.particles = shared.layers, shared.particles
        self.impulses, self.virial = shared.impulses, VirialPressure(shared, shared.density)
        self.longest_step = math.inf

    def tune(self, parameters: ProjectionParameters) -> None:
        """Does nothing: there are no live parameters."""

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
