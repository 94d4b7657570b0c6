"""External forces: gravity, inertial forces of a moving box, and a hand that moves the water."""

import math
from dataclasses import dataclass, field

import numpy as np
import taichi as ti

Vec3 = tuple[float, float, float]
STILL: Vec3 = (0.0, 0.0, 0.0)

vec3 = ti.math.vec3
# Axes after and before each axis.
NEXT, LAST = np.array([1, 2, 0]), np.array([2, 0, 1])
# Kernel arguments: Hand.numbers(), and ExternalForces.field().
HAND_NUMBERS, FIELD_NUMBERS = ti.types.vector(14, ti.f32), ti.types.vector(9, ti.f32)


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
        `distance` [m]: a step dt gives the water at most the speed V min(1, grip dt)."""
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
    """Gravity [m/s^2] in the box's frame, the hand, and the inertial forces of a moving box.

    angular_velocity [rad/s] and angular_acceleration [rad/s^2] of the box about its centre;
    inertia [m/s^2]: inertial acceleration at the centre, i.e. minus the acceleration of the centre.
    All are constant within a step, gravity and hand within a frame.
    """

    gravity: Vec3 = (0.0, -9.81, 0.0)
    hand: Hand = field(default_factory=Hand)
    angular_velocity: Vec3 = STILL
    angular_acceleration: Vec3 = STILL
    inertia: Vec3 = STILL

    def at(self, time: float, dt: float) -> "ExternalForces":
        """Returns the external forces of a step of dt [s] from `time` [s]."""
        return self

    @property
    def moving(self) -> bool:
        """True if there are inertial forces."""
        return any((*self.inertia, *self.angular_velocity, *self.angular_acceleration))

    @property
    def apparent_gravity(self) -> Vec3:
        """Sum of gravity and inertia [m/s^2] for water at rest at the box's centre."""
        x, y, z = (g + a for g, a in zip(self.gravity, self.inertia, strict=True))
        return x, y, z

    def field(self) -> tuple[float, ...]:
        """Returns the numbers of field_at() for gravity and inertia."""
        return *self.apparent_gravity, *self.angular_velocity, *self.angular_acceleration

    def inertial_field(self) -> tuple[float, ...]:
        """Returns the numbers of field_at() for inertia alone."""
        return *self.inertia, *self.angular_velocity, *self.angular_acceleration

    def inertia_at(self, r: np.ndarray, v: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
        """Returns the inertial accelerations [m/s^2] of points at r [m] from the centre, and the
        Coriolis accelerations of points with velocities v [m/s] in a step of dt [s], (n, 3)."""
        w, rise = np.array(self.angular_velocity), np.array(self.angular_acceleration)
        found = np.array(self.inertia) - cross(rise, r) - cross(w, cross(w, r))
        return found, -2.0 * cross(w, v - dt * cross(w, v))


@ti.func
def hand_acceleration(x, v, dt, hand):
    """Returns the acceleration [m/s^2] that the hand gives water at x [m] with velocity v [m/s].

    The acceleration decreases as (1 - q)^2, q = sum (r_k/R_k)^2, and is limited so that a step of
    dt [s] does not overshoot the hand's velocity field.
    """
    r = x - vec3(hand[0], hand[1], hand[2])
    u = ti.max(1.0 - (r * vec3(hand[6], hand[7], hand[8])).norm_sqr(), 0.0)
    own = vec3(hand[3], hand[4], hand[5]) + vec3(hand[9], hand[10], hand[11]).cross(r)
    return ti.min(hand[13] * u * u, 1.0 / dt) * (own - hand[12] * r - v)


@ti.func
def field_at(r, numbers):
    """Returns the acceleration [m/s^2] without Coriolis at r [m] from the centre of a moving box.

    numbers: acceleration at the centre, angular velocity w and angular acceleration, which give the
    Euler and centrifugal accelerations.
    """
    w, rise = turning(numbers), vec3(numbers[6], numbers[7], numbers[8])
    return vec3(numbers[0], numbers[1], numbers[2]) - rise.cross(r) - w.cross(w.cross(r))


@ti.func
def turning(numbers):
    """Returns the angular velocity [rad/s] of the box."""
    return vec3(numbers[3], numbers[4], numbers[5])


@ti.func
def coriolis(v, dt, w):
    """Returns the Coriolis acceleration -2 w x v' [m/s^2], with v' the velocity in the middle of
    the step, so that it does no work to second order in dt [s]."""
    return -2.0 * w.cross(v - dt * w.cross(v))


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Returns the cross products of vectors (..., 3): np.cross takes four times as long for few."""
    return a.take(NEXT, -1) * b.take(LAST, -1) - a.take(LAST, -1) * b.take(NEXT, -1)


def as_vector(values: np.ndarray) -> Vec3:
    """Returns an array (3,) as a tuple."""
    x, y, z = values.tolist()
    return x, y, z


def rotation_vector(rotation: np.ndarray) -> np.ndarray:
    """Returns axis times angle [rad] of a rotation matrix with an angle below pi."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = rotation.tolist()
    axis = 0.5 * (zy - yz), 0.5 * (xz - zx), 0.5 * (yx - xy)
    sine = math.hypot(*axis)
    angle = math.atan2(sine, 0.5 * (xx + yy + zz - 1.0))
    return np.array(axis) * (angle / sine if sine > 0.0 else 1.0)


# Gravity alone, without a hand.
NO_HAND = ExternalForces()
