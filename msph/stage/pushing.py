"""Hand at the cursor: pushes the water along with the mouse."""

from typing import Any

import numpy as np

from msph.fluid.external_forces import Hand
from msph.stage.row import Row
from msph.stage.show import Show

# Radius and grip of a hovering cursor over those of a push; least radius of a hand in finest
# spacings, below which the hand slips between the particles.
WAKE_RADIUS, WAKE_GRIP, LEAST_RADIUS = 0.4, 0.25, 1.5
# Largest speed of a wake [m/s]: the cursor's ray jumps between wave crests.
WAKE_SPEED = 2.0


class PushingHand:
    """Hand of the mouse. place: its position [m] in the box frame, None without contact; over: the
    show under the cursor."""

    def __init__(self) -> None:
        self.place: Any = None
        self.over: Any = None
        self.pushes = False

    def push(self, row: Row, cursor: np.ndarray, step: float) -> Hand:
        """Returns the hand of a push in a frame of `step` [s]; cursor: (right, up) in shares of the
        window.

        A push begins where the cursor's ray meets the water, and continues at that depth and in
        that simulation.
        """
        if not self.pushes:
            self.over = row.show_under(cursor)[0]
        show, cursor = self.over, row.to_picture(self.over, cursor)
        eye, direction = show.ray(*(cursor * show.picture.size))
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
        """Returns the hand of a cursor that hovers over the water; it lets go between two
        simulations."""
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
    def _hit(show: Show, cursor: np.ndarray) -> np.ndarray | None:
        """Returns the point of the water [m], box frame, at the cursor, or None."""
        i, j = cursor * show.picture.size
        hit = show.pick(int(i), int(j))
        return None if hit is None else np.asarray(hit)
