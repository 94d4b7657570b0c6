"""External forces: gravity in the box's frame, and a hand that pushes the water."""

from dataclasses import dataclass, field

import taichi as ti

Vec3 = tuple[float, float, float]


@dataclass
class Hand:
    """A ball that drags the water inside it towards its own velocity.

    position [m] and velocity [m/s] in the box's frame, radius [m]; grip [1/s] is how fast the
    water at the centre takes the hand's velocity, 0 where no hand is in the water.
    """

    position: Vec3 = (0.0, 0.0, 0.0)
    velocity: Vec3 = (0.0, 0.0, 0.0)
    radius: float = 1.0
    grip: float = 0.0


@dataclass
class ExternalForces:
    """Gravity [m/s^2] in the box's frame, and the hand, constant within a frame."""

    gravity: Vec3 = (0.0, -9.81, 0.0)
    hand: Hand = field(default_factory=Hand)

    def arguments(self) -> tuple:
        """Arguments of kernels: gravity, and the hand's position, velocity, radius and grip."""
        h = self.hand
        return self.gravity, h.position, h.velocity, h.radius, h.grip


@ti.func
def hand_acceleration(x, v, dt, position, velocity, radius, grip):
    """Acceleration [m/s^2] that the hand gives to water at x [m] moving with v [m/s].

    Falls off as (1 - r^2/R^2)^2 and never overshoots the hand's velocity within one step dt [s].
    """
    u = ti.max(1.0 - (x - position).norm_sqr() / radius**2, 0.0)
    return ti.min(grip * u * u, 1.0 / dt) * (velocity - v)
