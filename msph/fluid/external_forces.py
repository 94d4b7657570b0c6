"""External forces: gravity in the box's frame, and a user-controlled ball that pushes the water."""

import math
from dataclasses import dataclass, field

import taichi as ti

Vec3 = tuple[float, float, float]


@dataclass
class Hand:
    """Ball that accelerates the water inside it towards its own velocity.

    position [m] and velocity [m/s] in the box's frame, radius [m]; grip [1/s] is the rate at the
    centre, 0 while the hand is out of the water.
    """

    position: Vec3 = (0.0, 0.0, 0.0)
    velocity: Vec3 = (0.0, 0.0, 0.0)
    radius: float = 1.0
    grip: float = 0.0

    def longest_step(self, distance: float) -> float:
        """Returns the largest time step [s] in which the hand moves water at rest by at most
        `distance` [m]: in a step dt it gives it at most the speed V min(1, grip dt)."""
        speed = math.hypot(*self.velocity)
        if self.grip * speed == 0.0:
            return math.inf
        return max(distance / speed, math.sqrt(distance / (self.grip * speed)))


@dataclass(frozen=True)
class ExternalForces:
    """Gravity [m/s^2] in the box's frame, and the hand; both constant within a frame."""

    gravity: Vec3 = (0.0, -9.81, 0.0)
    hand: Hand = field(default_factory=Hand)

    def arguments(self) -> tuple:
        """Returns kernel arguments: gravity; position, velocity, radius, grip of the hand."""
        h = self.hand
        return self.gravity, h.position, h.velocity, h.radius, h.grip


@ti.func
def hand_acceleration(x, v, dt, position, velocity, radius, grip):
    """Returns the acceleration [m/s^2] by the hand of water at x [m] with velocity v [m/s].

    Decreases as (1 - r^2/R^2)^2; limited so that a step of dt [s] does not overshoot the hand's
    velocity.
    """
    u = ti.max(1.0 - (x - position).norm_sqr() / radius**2, 0.0)
    return ti.min(grip * u * u, 1.0 / dt) * (velocity - v)


# Gravity alone, without a hand.
NO_HAND = ExternalForces()
