"""Steering: keys and mouse that tilt the pool, move the view and push the water."""

import math
import time
from typing import Any

import numpy as np

from msph.stage.controls import Controls
from msph.stage.pushing import PushingHand
from msph.stage.row import Row
from msph.stage.window import Window

ORBIT_PER_WIDTH = math.radians(200.0)  # a drag across the whole window turns the view so far
ORBIT_KEY_RATE = math.radians(70.0)  # [rad/s]
ZOOM_KEY_RATE = 1.5  # [1/s], as the logarithm of the distance
LEVELLING = 0.5  # rate at which a pool comes level over that of tilting it
CLICK_WAY, CLICK_TIME = 0.01, 0.4  # most way (shares of the window) and time [s] of a click
BUTTONS = ("LMB", "RMB", "MMB")


class Steering:
    """tilt: (roll, pitch) [rad] by hand; locked: True if the tilt stays. free: of each mouse button
    that is down whether it went down beside the pages. cursor: (right, up) in shares of the window,
    moved: its way since the frame before."""

    def __init__(self, window: Window, row: Row):
        self.window, self.row, self.hand = window, row, PushingHand()
        self.tilt: Any = np.zeros(2)
        self.locked = not row.lead.scene.play.level
        self.free: dict[str, bool] = {}
        self.cursor, self.moved = window.cursor(), np.zeros(2)
        self.down: Any = None  # where the left button went down, and when [s]

    def look(self) -> None:
        """Reads the cursor, and the shape of the window: resized, it shows the same pixels."""
        cursor = self.window.cursor()
        self.moved, self.cursor = cursor - self.cursor, cursor
        width, height = self.window.size
        self.row.lead.camera.stretch = self.window.aspect * height / width

    def hold(self, step: float, wall: float, paused: bool) -> bool:
        """Keys that act as long as they are down, in a frame of `step` [s] of simulated and `wall`
        [s] of wall-clock time; returns whether any is."""
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

    def held(self) -> tuple[bool, ...]:
        """Of BUTTONS whether each is down, and went down beside the pages."""
        return tuple(self.window.down(b) and self.free.get(b, True) for b in BUTTONS)

    def turn(self) -> str:
        """Moves the view as the mouse is dragged; returns the action, "" for none."""
        _, right, middle = self.held()
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
        left, right, middle = self.held()
        hover = self.row.lead.scene.play.hover and self.moved.any()
        if left:
            controls.hand = self.hand.push(self.row, self.cursor, step)
        elif hover and not (right or middle or on_page):
            controls.hand = self.hand.pass_over(self.row, self.cursor, step)
        else:
            controls.hand = self.hand.let_go()

    def clicked(self) -> bool:
        """True if the left button went up where it had gone down, and soon."""
        left, now = self.held()[0], time.perf_counter()
        if left and self.down is None:
            self.down = self.cursor, now
        elif not left and self.down is not None:
            (place, since), self.down = self.down, None
            still = np.abs(self.cursor - place).max() < CLICK_WAY
            return bool(still) and now - since < CLICK_TIME
        return False

    def pick(self) -> None:
        """Picks the particle under the cursor, of whichever simulation."""
        under, place = self.row.show_under(self.cursor)
        i, j = (int(v) for v in place * (under.picture.width, under.picture.height))
        found = under.particle_at(i, j)
        for other in self.row.shows:
            picked = None if found is None or other is not under else found[0]
            other.views.neighbourhood.pick(picked)
