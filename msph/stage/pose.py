"""Pose of the box: the scene's motion, and the user's tilt after it."""

from dataclasses import replace

import numpy as np

from msph.fluid.boundary.rigid_bodies import rotations
from msph.fluid.external_forces import Hand, Vec3, rotation_vector
from msph.fluid.moving_box import MovingBox
from msph.scene.motion import box_path
from msph.scene.schema import Scene
from msph.stage.controls import Inputs


class Pose:
    """Rotation `tilt`, (3, 3), of the box and displacement `shift` [m], (3,), of its centre, in
    world axes.

    by_hand: the user's tilt of the present frame; turned: of the last frame, None if the box does
    not turn from there; turning [rad/s]: angular velocity of the user's tilt in world axes.
    """

    def __init__(self, scene: Scene):
        self.path = box_path(scene)
        self.by_hand: np.ndarray = np.eye(3)
        self.tilt, self.shift = np.eye(3), np.zeros(3)
        self.reset(0.0)

    def reset(self, time: float) -> None:
        """Sets the pose at a time [s], with no turn by the user before."""
        self.turned: np.ndarray | None = None
        self.turning: np.ndarray = np.zeros(3)
        self.place(time)

    def place(self, time: float) -> None:
        """Sets the pose at a time [s]."""
        self.shift, turned = self.path(time)
        self.tilt = self.by_hand @ turned

    def take(self, inputs: Inputs, time: float) -> None:
        """Sets the user's tilt at a time [s]."""
        roll, pitch = inputs.tilt
        vectors = (0.0, inputs.azimuth, 0.0), (0.0, 0.0, roll), (pitch, 0.0, 0.0)
        view, first, then = rotations(np.array(vectors))
        self.by_hand = view @ then @ first @ view.T
        self.place(time)

    def pause(self) -> None:
        """Prevents a sudden turn of the box by a tilt given during a pause; a pause alone changes
        nothing."""
        if self.turned is not None and not np.array_equal(self.by_hand, self.turned):
            self.turned = None

    def at_rest(self, gravity: Vec3, time: float) -> MovingBox:
        """Returns the box at a time [s], without a hand and without a turn by the user; gravity
        [m/s^2] in world axes."""
        return MovingBox(gravity, self.path, time, tilt=self.by_hand)

    def turn(self, gravity: Vec3, time: float, step: float, hand: Hand) -> MovingBox:
        """Returns the box of a frame of `step` [s] from `time` [s] on, in which the box turns from
        the last frame's tilt to the present tilt."""
        last, before = self.by_hand if self.turned is None else self.turned, self.turning
        self.turned, self.turning = self.by_hand, rotation_vector(self.by_hand @ last.T) / step
        rising = (self.turning - before) / step
        box = self.at_rest(gravity, time)
        return replace(box, hand=hand, turning=self.turning, rising=rising)
