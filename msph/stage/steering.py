"""Steering: keys and mouse that tilt the pool, move the camera and use the tools."""

import math
import time
from collections import deque
from typing import Any

import numpy as np

from msph.stage.controls import ToolUse
from msph.stage.ggui_window import Window
from msph.stage.row import Row
from msph.stage.tools import TOOLS, Tool
from msph.stage.water_cursor import WaterCursor
from msph.stage.window import BUTTONS

ORBIT_PER_WIDTH = math.radians(200.0)  # orbit of a drag across the window's width [rad]
ORBIT_KEY_RATE = math.radians(70.0)  # [rad/s]
ZOOM_KEY_RATE = 1.5  # [1/s], as the logarithm of the distance
LEVELLING = 0.5  # rate of levelling over the rate of tilting
# Time in which the rate of tilting follows the keys [s]: sudden rotations throw the water.
EASE = 0.08
LEVEL = math.radians(0.05)  # tilt that counts as level
# Jolt: largest tilt [rad], duration [s] and number of swings.
JOLT_TILT, JOLT_TIME, JOLT_SWINGS = math.radians(8.0), 1.2, 2.0
CLICK_WAY, CLICK_TIME = 0.01, 0.4  # largest way (shares of the window) and duration [s] of a click


class Steering:
    """User's tilt, camera motion and tool. tilt: (roll, pitch) [rad]; rate: of the tilt [rad/s];
    locked: True to keep the tilt; levels: True to level the pool once, even if locked; jolted:
    simulated time since the start of a jolt [s]; tool: the active tool; free: True for each mouse
    button pressed outside the pages; cursor: (right, up) in shares of the window; moved: motion of
    the cursor since the last frame."""

    def __init__(self, window: Window, row: Row):
        self.window, self.row, self.contact = window, row, WaterCursor()
        self.tool = TOOLS[0]
        self.tilt: Any = np.zeros(2)
        self.rate: Any = np.zeros(2)
        self.levels, self.jolted = False, math.inf
        self.locked = not row.lead.scene.play.level
        self.free: dict[str, bool] = {}
        self.cursor, self.moved = window.cursor(), np.zeros(2)
        # Presses that have not acted yet: tool and cursor.
        self.clicks: deque[tuple[Tool, np.ndarray]] = deque()
        self.down: Any = None  # position and time [s] at which the left button was pressed

    def read_cursor(self) -> None:
        """Reads the cursor, and adapts the camera to a resized window."""
        cursor = self.window.cursor()
        self.moved, self.cursor = self.moved + cursor - self.cursor, cursor
        width, height = self.window.size
        self.row.lead.display.camera.stretch = self.window.aspect * height / width

    def press(self, button: str, free: bool) -> None:
        """Stores the press of a mouse button; free: outside the pages."""
        self.free[button] = free
        if free and button == "LMB":
            self.clicks.append((self.tool, self.cursor))

    def apply_keys(self, step: float, wall: float, paused: bool) -> bool:
        """Applies keys held down in a frame of `step` [s] simulated and `wall` [s] wall-clock time;
        returns True if there are any. The tilt waits while the simulation has not answered."""
        down, camera = self.window.down, self.row.lead.display.camera
        asked = np.array([down("Left") - down("Right"), down("Down") - down("Up")], float)
        if not self.row.busy:
            self._tilt_by(asked, step, paused)
        orbit, zoom = down("d") - down("a"), down("s") - down("w")
        camera.orbit(ORBIT_KEY_RATE * wall * orbit, 0.0)
        camera.zoom(math.exp(ZOOM_KEY_RATE * wall * zoom))
        return bool(asked.any() or orbit or zoom)

    def _tilt_by(self, asked: np.ndarray, step: float, paused: bool) -> None:
        """Tilts the pool in a frame of `step` [s] towards `asked`, (2,) of -1, 0 or 1, or levels it
        where `asked` is 0, unless `paused`."""
        play = self.row.lead.scene.play
        fastest, limit = math.radians(play.tilt_rate), math.radians(play.tilt_limit)
        self.levels = self.levels and not asked.any() and bool(self.tilt.any())
        # Critically damped: levelling at a constant rate would end suddenly.
        back = np.clip(-self.tilt / (4.0 * EASE), -LEVELLING * fastest, LEVELLING * fastest)
        back *= (not self.locked or self.levels) and not paused
        wanted = np.where(asked == 0.0, back, fastest * asked)
        self.rate += (wanted - self.rate) * (1.0 if paused else min(step / EASE, 1.0))
        before = self.tilt
        self.tilt = np.clip(before + self.rate * step, -limit, limit)
        self.rate = (self.tilt - before) / step
        reached = (back != 0.0) & (asked == 0.0) & (np.abs(self.tilt) < LEVEL)
        self.tilt[reached] = self.rate[reached] = 0.0
        self.jolted += 0.0 if paused else step

    @property
    def jolt(self) -> float:
        """Current roll of a jolt [rad]."""
        share = self.jolted / JOLT_TIME
        if share >= 1.0:
            return 0.0
        swing = math.sin(2.0 * math.pi * JOLT_SWINGS * share)
        return JOLT_TILT * swing * math.sin(math.pi * share)

    def stop(self) -> None:
        """Levels the pool and ends the use of a tool at once, as after a reset."""
        self.contact.let_go()
        self.tilt, self.rate = np.zeros(2), np.zeros(2)
        self.levels, self.jolted = False, math.inf

    def held_buttons(self) -> tuple[bool, ...]:
        """Returns for each of BUTTONS whether it is down and was pressed outside the pages."""
        return tuple(self.window.down(b) and self.free.get(b, True) for b in BUTTONS)

    def drag_camera(self) -> str:
        """Moves the camera with a mouse drag; returns the action, "" for none."""
        _, right, middle = self.held_buttons()
        camera, (x, y) = self.row.lead.display.camera, self.moved
        if middle or (right and self.window.down("Shift")):
            across = 2.0 * math.tan(0.5 * camera.fov) * camera.distance
            camera.pan(-x * across * self.window.aspect, -y * across)
            return "pan"
        if right:
            camera.orbit(-x * ORBIT_PER_WIDTH, -y * ORBIT_PER_WIDTH)
            return "orbit"
        return ""

    def use_tool(self, still: bool, step: float, on_page: bool) -> ToolUse | None:
        """Returns the use of a tool where the left button holds water, otherwise the wake of the
        cursor. still: no time passes. Each press while the simulation has not answered acts later,
        in a frame of its own, with the tool that was active when the button was pressed."""
        left, right, middle = self.held_buttons()
        if self.row.busy:
            return None
        tool, cursor = self.tool, self.cursor
        if self.clicks:
            # The last press may still be within its least duration.
            self.contact.let_go()
            (tool, cursor), left = self.clicks.popleft(), True
        left = left or self.contact.clicked
        hover = self.row.lead.scene.play.hover and self.moved.any()
        if left and not still:
            return self.contact.hold(tool, self.row, cursor, step)
        if hover and not (right or middle or on_page):
            wake = self.contact.pass_over(self.row, self.cursor, step)
            return None if still else wake
        self.contact.let_go()
        return None

    def clicked(self, pressed: bool) -> bool:
        """Returns True if the left button was released near its position and time of press.
        pressed: since the last frame; if the button is up again, that was a click."""
        left, now = self.held_buttons()[0], time.perf_counter()
        if pressed and not left and self.down is None:
            return self.free.get("LMB", True)
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
        i, j = place * target.display.picture.size
        found = target.display.particle_at(int(i), int(j))
        for show in self.row.shows:
            index = found[0] if found and show is target else None
            show.display.views.neighbourhood.pick(index)
