"""The hand under the cursor: it drags the water where the mouse goes."""

from typing import Any

import numpy as np

from msph.fluid.external_forces import Hand
from msph.stage.row import Row
from msph.stage.show import Show

# Radius and grip of a cursor that only passes over the water, over those of a push; least radius of
# a hand, in finest spacings: a smaller one slips between the particles.
WAKE_RADIUS, WAKE_GRIP, LEAST_RADIUS = 0.4, 0.25, 1.5
# Fastest wake [m/s]: a cursor that jumps from wave to wave must not throw water.
WAKE_SPEED = 2.0


class PushingHand:
    """place: where it holds the water [m], in the box's frame, None while it does not; over: the
    water that it is over, of those side by side."""

    def __init__(self) -> None:
        self.place: Any = None
        self.over: Any = None
        self.pushes = False

    def push(self, row: Row, cursor: np.ndarray, step: float) -> Hand:
        """A push in a frame of `step` [s], cursor: (right, up) in shares of the window.

        The water is taken where the cursor's ray meets it, and dragged at that depth; it is the
        one that the push began in, wherever the cursor is by now.
        """
        if not self.pushes:
            self.over = row.show_under(cursor)[0]
        show, cursor = self.over, row.to_picture(self.over, cursor)
        eye, direction = self._ray(show, cursor)
        if not self.pushes:
            self.place = self._hit(show, cursor)
            self.pushes = self.place is not None
        if not self.pushes:
            return Hand()
        axis = show.tilt.T @ -show.camera.axes()[2]
        before = self.place
        self.place = eye + (before - eye) @ axis / (direction @ axis) * direction
        return self._hand(show, (self.place - before) / step)

    def pass_over(self, row: Row, cursor: np.ndarray, step: float) -> Hand:
        """A wake where the cursor moves over the water without a push; from one water to the next
        the hand lets go."""
        show, cursor = row.show_under(cursor)
        if show is not self.over:
            self.let_go()
        self.over = show
        hit = self._hit(show, cursor)
        before, self.place, self.pushes = self.place, hit, False
        if hit is None or before is None:
            return Hand()
        velocity = (hit - before) / step
        velocity *= min(1.0, WAKE_SPEED / max(float(np.linalg.norm(velocity)), 1e-9))
        return self._hand(show, velocity, WAKE_RADIUS, WAKE_GRIP)

    def let_go(self) -> Hand:
        self.place, self.pushes = None, False
        return Hand()

    def _hand(self, show: Show, velocity: np.ndarray, radius: float = 1.0, grip: float = 1.0):
        play, sim = show.scene.play, show.simulation
        least = LEAST_RADIUS * sim.layers.finest.spacing
        return Hand(
            position=tuple(self.place.tolist()),
            velocity=tuple(velocity.tolist()),
            radius=max(radius * play.push_radius * max(sim.size), least),
            grip=grip * play.push_grip,
        )

    @staticmethod
    def _ray(show: Show, cursor: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        size = show.picture.width, show.picture.height
        i, j = cursor * size
        return show.camera.box_ray(i, j, *size, show.simulation.size, show.tilt)

    @staticmethod
    def _hit(show: Show, cursor: np.ndarray) -> np.ndarray | None:
        i, j = cursor * (show.picture.width, show.picture.height)
        hit = show.pick(int(i), int(j))
        return None if hit is None else np.asarray(hit)
