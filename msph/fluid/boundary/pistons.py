"""Motion of a piston: a block in place of a wall of the box, which moves into the box.

The wall behind a piston mirrors nothing (constants.covered), so that the piston may also stand at
the wall.
"""

from dataclasses import dataclass

import numpy as np

from msph.parameter import LARGEST

# Tolerance (-) for the rounding of times.
ROUNDING = 1e-6


@dataclass
class Stroke:
    """Motion of a piston from its wall into the box: from `place` [m] at the time `start` [s], with
    a speed [m/s] that changes evenly from `speed` to `next_speed` within `duration` [s], and at
    rest afterwards. wall: the replaced wall, as a bit (Walls.near)."""

    wall: int
    start: float = 0.0
    place: float = 0.0
    speed: float = 0.0
    next_speed: float = 0.0
    duration: float = 0.0
    spins = False
    moves = True

    @property
    def axis(self) -> int:
        """Axis of the motion."""
        return (self.wall.bit_length() - 1) % 3

    @property
    def inwards(self) -> np.ndarray:
        """Unit vector (3,) from the wall into the box."""
        return (1.0 if self.wall < 8 else -1.0) * np.eye(3)[self.axis]

    @property
    def slides(self) -> np.ndarray:
        """Axes along which the body translates, (3,) bool."""
        return self.inwards != 0.0

    def at(self, time: float) -> tuple[float, float]:
        """Returns place [m] and speed [m/s]."""
        elapsed = time - self.start
        t, rest = min(max(elapsed, 0.0), self.duration), elapsed > self.duration * (1.0 + ROUNDING)
        gain = (self.next_speed - self.speed) / self.duration if self.duration else 0.0
        place = self.place + t * (self.speed + 0.5 * gain * t)
        return place, 0.0 if rest else self.speed + gain * t

    def steer(self, time: float, speed: float, duration: float) -> None:
        """Changes the speed evenly to `speed` [m/s] within `duration` [s] from `time` [s] on."""
        self.place, self.speed = self.at(time)
        self.start, self.next_speed, self.duration = time, speed, duration

    def offset(self, time: float) -> np.ndarray:
        """Returns the displacement from the wall [m], (3,)."""
        return self.at(time)[0] * self.inwards

    def rotation(self, time: float) -> np.ndarray:
        """Returns the rotation, (3, 3): none."""
        return np.eye(3)

    def top_speed(self, reach: float) -> float:
        """Returns the largest speed [m/s] of the present motion."""
        return max(abs(self.speed), abs(self.next_speed))

    def state(self) -> np.ndarray:
        """Returns all numbers, (6,), for checkpoints."""
        return np.array(list(vars(self).values()), float)

    @classmethod
    def of(cls, state: np.ndarray) -> "Stroke":
        """Returns the motion of a state(). Raises ValueError."""
        possible = state.shape == (6,) and (np.abs(state) <= LARGEST).all()
        if not possible or state[0] not in (1, 4, 8, 32):
            raise ValueError("a moving wall has no finite place and speed at a side of the box")
        return cls(int(state[0]), *state[1:].tolist())
