"""Steering: keys and mouse that tilt the pool, move the camera and push the water."""

import math
import time
from typing import Any

import numpy as np

from msph.stage.controls import Controls
from msph.stage.pushing import PushingHand
from msph.stage.row import Row
from msph.stage.window import BUTTONS, Window

ORBIT_PER_WIDTH = math.radians(200.0)  # orbit of a drag across the window's width [rad]
ORBIT_KEY_RATE = math.radians(70.0)  # [rad/s]
ZOOM_KEY_RATE = 1.5  # [1/s], as the logarithm of the distance
LEVELLING = 0.5  # rate of levelling over the rate of tilting
CLICK_WAY, CLICK_TIME = 0.01, 0.4  # largest way (shares of the window) and duration [s] of a click


class Steering:
    """User's tilt, camera motion and push. tilt: (roll, pitch) [rad]; locked: keep the tilt; free:
    True for each mouse button pressed outside the pages; cursor: (right, up) in shares of the
    window; moved: its motion since the previous frame."""

    def __init__(self, window: Window, row: Row):
        self.window, self.row, self.hand = window, row, PushingHand()
        self.tilt: Any = np.zeros(2)
        self.locked = not row.lead.scene.play.level
        self.free: dict[str, bool] = {}
        self.cursor, self.moved = window.cursor(), np.zeros(2)
        self.down: Any = None  # position and time [s] at which the left button was pressed

    def read_cursor(self) -> None:
        """Reads the cursor, and adapts the camera to a resized window."""
        cursor = self.window.cursor()
        self.moved, self.cursor = cursor - self.cursor, cursor
        width, height = self.window.size
        self.row.lead.camera.stretch = self.window.aspect * height / width

    def apply_keys(self, step: float, wall: float, paused: bool) -> bool:
        """Applies keys held down in a frame of `step` [s] simulated and `wall` [s] wall-clock time;
        returns True if there are any."""
        down, camera, play = self.window.down, self.row.lead.camera, self.row.lead.scene.play
        rate, limit = math.radians(play.tilt_rate) * step, math.radians(play.tilt_limit)
        asked = np.array([down("Left") - down("Right"), down("Down") - down("Up")], float)
        back = LEVELLING * rate * (asked == 0.0) * (not self.locked and not paused)
        self.tilt -= np.clip(self.tilt, -back, back)
        self.tilt = np.clip(self.tilt + rate * asked, -limit, limit)
        orbit, zoom = down("d") - down("a"), down("s") - down("w")
        camera.orbit(ORBIT_KEY_RATE * wall * orbit, 0.0)
        camera.zoom(math.exp(ZOOM_KEY_RATE * wall * zoom))
        return bool(asked.any() or orbit or zoom)

    def held_buttons(self) -> tuple[bool, ...]:
        """Returns for each of BUTTONS whether it is down and was pressed outside the pages."""
        return tuple(self.window.down(b) and self.free.get(b, True) for b in BUTTONS)

    def drag_camera(self) -> str:
        """Moves the camera with a mouse drag; returns the action, "" for none."""
        _, right, middle = self.held_buttons()
        camera, (x, y) = self.row.lead.camera, self.moved
        if middle or (right and self.window.down("Shift")):
            across = 2.0 * math.tan(0.5 * camera.fov) * camera.distance
            camera.pan(-x * across * self.window.aspect, -y * across)
            return "pan"
        if right:
            camera.orbit(-x * ORBIT_PER_WIDTH, -y * ORBIT_PER_WIDTH)
            return "orbit"
        return ""

    def push(self, controls: Controls, step: float, on_page: bool) -> None:
        """Moves the hand with the cursor."""
        left, right, middle = self.held_buttons()
        hover = self.row.lead.scene.play.hover and self.moved.any()
        if left:
            controls.hand = self.hand.push(self.row, self.cursor, step)
        elif hover and not (right or middle or on_page):
            controls.hand = self.hand.pass_over(self.row, self.cursor, step)
        else:
            controls.hand = self.hand.let_go()

    def clicked(self) -> bool:
        """Returns True if the left button was released near its position and time of press."""
        left, now = self.held_buttons()[0], time.perf_counter()
        if left and self.down is None:
            self.down = self.cursor, now
        elif not left and self.down is not None:
            (place, since), self.down = self.down, None
            still = np.abs(self.cursor - place).max() < CLICK_WAY
            return bool(still) and now - since < CLICK_TIME
        return False

    def pick(self) -> None:
        """Picks the particle at the cursor, in any of the simulations."""
        target, place = self.row.show_under(self.cursor)
        i, j = (int(v) for v in place * (target.picture.width, target.picture.height))
        found = target.particle_at(i, j)
        for show in self.row.shows:
            index = found[0] if found and show is target else None
            show.views.neighbourhood.pick(index)
