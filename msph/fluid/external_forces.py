"""External forces: gravity and the rotation of the box's frame, and a hand that moves the water."""

import math
from dataclasses import dataclass, field

import numpy as np
import taichi as ti

Vec3 = tuple[float, float, float]
STILL: Vec3 = (0.0, 0.0, 0.0)

vec3 = ti.math.vec3
# Kernel arguments: Hand.numbers(), and ExternalForces.turn.
HAND_NUMBERS, TURN_NUMBERS = ti.types.vector(14, ti.f32), ti.types.vector(6, ti.f32)


@dataclass(frozen=True)
class Hand:
    """Ellipsoid that accelerates the water inside it towards its own velocity field.

    In the box's frame: position [m]; radii [m] along the axes, infinite for a column or a slab. At
    r [m] from the position the velocity field is velocity + spin x r - draw r: velocity [m/s], spin
    [rad/s], draw [1/s] towards the position. grip [1/s] is the rate at the centre, 0 while the hand
    is out of the water.
    """

    position: Vec3 = STILL
    velocity: Vec3 = STILL
    radii: Vec3 = (1.0, 1.0, 1.0)
    grip: float = 0.0
    spin: Vec3 = STILL
    draw: float = 0.0

    def top_speed(self) -> float:
        """Returns an upper bound of the velocity field's speed in the ellipsoid [m/s]."""
        reach = [r for r in self.radii if math.isfinite(r)]
        turning = math.hypot(math.hypot(*self.spin), self.draw)
        return math.hypot(*self.velocity) + (turning * max(reach) if turning else 0.0)

    def longest_step(self, distance: float) -> float:
        """Returns the largest time step [s] in which the hand moves water at rest by at most
        `distance` [m]: in a step dt it gives it at most the speed V min(1, grip dt)."""
        speed = self.top_speed()
        if self.grip * speed == 0.0:
            return math.inf
        return max(distance / speed, math.sqrt(distance / (self.grip * speed)))

    def numbers(self) -> tuple[float, ...]:
        """Returns position, velocity, 1/radii, spin, draw and grip for hand_acceleration()."""
        per_radius = (1.0 / r for r in self.radii)
        return *self.position, *self.velocity, *per_radius, *self.spin, self.draw, self.grip


@dataclass(frozen=True)
class ExternalForces:
    """Gravity [m/s^2] in the box's frame, the hand, and the rotation of the box about its centre:
    angular velocity [rad/s] and angular acceleration [rad/s^2]; all constant within a frame."""

    gravity: Vec3 = (0.0, -9.81, 0.0)
    hand: Hand = field(default_factory=Hand)
    angular_velocity: Vec3 = STILL
    angular_acceleration: Vec3 = STILL

    def arguments(self) -> tuple:
        """Returns kernel arguments: gravity, numbers of the hand and of the rotation."""
        turn = (*self.angular_velocity, *self.angular_acceleration)
        return self.gravity, self.hand.numbers(), turn


@ti.func
def hand_acceleration(x, v, dt, hand):
    """Returns the acceleration [m/s^2] by the hand of water at x [m] with velocity v [m/s].

    Decreases as (1 - q)^2, q = sum (r_k/R_k)^2; limited so that a step of dt [s] does not overshoot
    the hand's velocity field.
    """
    r = x - vec3(hand[0], hand[1], hand[2])
    u = ti.max(1.0 - (r * vec3(hand[6], hand[7], hand[8])).norm_sqr(), 0.0)
    own = vec3(hand[3], hand[4], hand[5]) + vec3(hand[9], hand[10], hand[11]).cross(r)
    return ti.min(hand[13] * u * u, 1.0 / dt) * (own - hand[12] * r - v)


@ti.func
def field_in_turning_box(r, turn):
    """Returns the Euler and centrifugal accelerations [m/s^2] at r [m] from the centre of a box
    that rotates as `turn` says: angular velocity w, angular acceleration."""
    w, rise = vec3(turn[0], turn[1], turn[2]), vec3(turn[3], turn[4], turn[5])
    return -rise.cross(r) - w.cross(w.cross(r))


@ti.func
def coriolis(v, dt, turn):
    """Returns the Coriolis acceleration -2 w x v' [m/s^2], with v' the velocity in the middle of
    the step, so that it does no work to second order in dt [s]."""
    w = vec3(turn[0], turn[1], turn[2])
    return -2.0 * w.cross(v - dt * w.cross(v))


def as_vector(values: np.ndarray) -> Vec3:
    """Returns an array (3,) as a tuple."""
    x, y, z = values.tolist()
    return x, y, z


def rotation_vector(rotation: np.ndarray) -> np.ndarray:
    """Returns axis times angle [rad] of a rotation matrix with an angle below pi."""
    axis = 0.5 * np.array(
        [
            rotation[2, 1] - rotation[1, 2],
            rotation[0, 2] - rotation[2, 0],
            rotation[1, 0] - rotation[0, 1],
        ]
    )
    sine = float(np.linalg.norm(axis))
    angle = math.atan2(sine, 0.5 * (float(np.trace(rotation)) - 1.0))
    return axis * (angle / sine) if sine > 0.0 else axis


# Gravity alone, without a hand.
NO_HAND = ExternalForces()
