"""Gravity, the hand, and what gravity adds to the pressure behind walls."""

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
    """Accelerates all water by the external forces."""

    ATTRIBUTES: tuple[Attribute, ...] = ()

    @staticmethod
    def wanted(parameters: ProjectionParameters) -> bool:
        return True

    def __init__(self, shared: Discretisation):
        self.layers, self.particles = shared.layers, shared.particles
        self.impulses = shared.impulses
        self.virial = VirialPressure(
            shared.layers,
            shared.particles,
            shared.neighbours,
            shared.density,
        )
        self.longest_step = math.inf

    def tune(self, parameters: ProjectionParameters) -> None:
        """None of its parameters is live."""

    def apply(self, dt: float, external: ExternalForces) -> None:
        """Velocities after dt [s] of the external forces."""
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
        """v* = v + dt (g + hand + what images have more pressure than their particles)."""
        p = self.particles
        for i in range(n):
            m, x, v = self.layers.mass[p.layer[i]], p.x[i], p.v[i]
            wall = self.virial.image_acceleration(i, gravity)
            hand = hand_acceleration(x, v, dt, hand_position, hand_velocity, hand_radius, hand_grip)
            self.impulses.record_hand(m, v, dt, hand, gravity + wall)
            self.impulses.wall_impulse[None] += m * dt * wall
            p.v[i] = v + dt * (gravity + wall + hand)
