"""Motion of the box: its pose over time, and the inertial forces in its frame."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from msph.fluid.external_forces import (
    ExternalForces,
    Hand,
    Vec3,
    as_vector,
    cross,
    rotation_vector,
)

# Displacement of the box's centre [m], (3,), and rotation of the box about it, (3, 3), in world
# axes at a time [s].
Path = Callable[[float], tuple[np.ndarray, np.ndarray]]

# Interval [s] of the differences that give velocities: short compared with any motion, long enough
# for rounding in double precision.
INTERVAL = 1e-4


def at_rest(time: float) -> tuple[np.ndarray, np.ndarray]:
    """Returns no displacement and no rotation: the path of a box that does not move."""
    return np.zeros(3), np.eye(3)


@dataclass(frozen=True)
class MovingBox:
    """External forces of a frame in a box that follows a path and that the user tilts.

    world_gravity [m/s^2] in world axes; start [s]: of the frame. tilt: rotation (3, 3) by the user
    in world axes, after the rotation by the path; turning [rad/s] and rising [rad/s^2]: angular
    velocity and acceleration of the tilt.
    """

    world_gravity: Vec3
    path: Path = at_rest
    start: float = 0.0
    hand: Hand = field(default_factory=Hand)
    tilt: Any = field(default_factory=lambda: np.eye(3))
    turning: Any = field(default_factory=lambda: np.zeros(3))
    rising: Any = field(default_factory=lambda: np.zeros(3))

    @property
    def turned_by_hand(self) -> bool:
        """True if the user's tilt changes in the frame."""
        return bool(self.turning.any() or self.rising.any())

    @property
    def gravity(self) -> Vec3:
        """Gravity [m/s^2] in the frame of the box at the start; its change within the frame counts
        as inertia, so that potential energy is defined."""
        return self._gravity(self.path(self.start)[1])

    @property
    def up(self) -> np.ndarray:
        """Vertical unit vector (3,) in the frame of the box at the start."""
        return (self.tilt @ self.path(self.start)[1]).T @ np.array((0.0, 1.0, 0.0))

    def _gravity(self, turned: np.ndarray) -> Vec3:
        return as_vector((self.tilt @ turned).T @ np.array(self.world_gravity))

    def at(self, time: float, dt: float) -> ExternalForces:
        """Returns the external forces of a step of dt [s] from `time` [s]. They contain the whole
        change of the box's velocity within the step, also where the velocity jumps."""
        if self.path is at_rest and not self.turned_by_hand:
            return ExternalForces(self.gravity, self.hand)
        turned = self.path(time + 0.5 * dt)[1]
        frame, gravity = self.tilt @ turned, np.array(self.gravity)
        acceleration, spin, rise = self._rates(time, dt)
        spin = self.tilt @ spin
        rise = self.rising + self.tilt @ rise + cross(self.turning, spin)
        inertia = np.array(self._gravity(turned)) - gravity - frame.T @ acceleration
        rates = (as_vector(frame.T @ v) for v in (self.turning + spin, rise))
        return ExternalForces(as_vector(gravity), self.hand, *rates, as_vector(inertia))

    def _rates(self, time: float, dt: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Returns the acceleration [m/s^2] of the path's centre, its angular velocity [rad/s] and
        angular acceleration [rad/s^2], means over a step."""
        if dt == 0.0:
            return np.zeros(3), self._velocities(time)[1], np.zeros(3)
        (v0, w0), (v1, w1) = (self._velocities(t) for t in (time, time + dt))
        return (v1 - v0) / dt, 0.5 * (w0 + w1), (w1 - w0) / dt

    def _velocities(self, time: float) -> tuple[np.ndarray, np.ndarray]:
        """Returns velocity [m/s] and angular velocity [rad/s] of the path."""
        begin, end = max(time - INTERVAL, 0.0), time + INTERVAL
        (x0, r0), (x1, r1) = self.path(begin), self.path(end)
        return (x1 - x0) / (end - begin), rotation_vector(r1 @ r0.T) / (end - begin)
