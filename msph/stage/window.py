"""The window: GGUI shows the picture and brings keys and mouse."""

import contextlib
import ctypes
import math
import os
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import taichi as ti

from msph.fluid.external_forces import Hand
from msph.stage.controls import KEYS, Controls
from msph.stage.show import Show
from msph.stage.start_screen import StartScreen

ORBIT_PER_WIDTH = math.radians(200.0)  # a drag across the whole window turns the view so far
ORBIT_KEY_RATE = math.radians(70.0)  # [rad/s]
ZOOM_KEY_RATE = 1.5  # [1/s], as the logarithm of the distance
PANEL = (10.0, 10.0, 290.0, 155.0)  # left, top, width, height of the panel [pixels]
SETTINGS = Path("imgui.ini")  # where the panel's library leaves its state, unasked
MARKER_RADIUS = 0.008  # of the marker under a pushing cursor, as a share of the window's height
SMOOTHING = 0.9  # weight of the past in the displayed frame rate
QUIT = ("q", ti.ui.ESCAPE)  # keys that close the window
REAL_TIME = 0.97  # simulated over wall-clock time that passes for real time


# Least time between two pictures of the start [s]: each takes some milliseconds from compiling.
TELL_PAUSE = 0.12


class NoWindowError(RuntimeError):
    """No window can be opened here; the text says why."""


class ClosedError(Exception):
    """The window was closed before its first frame."""


def check_display() -> None:
    """Raises NoWindowError where there is no X server to show a window.

    GGUI's window library ends the whole process when it finds none, so we look before it does.
    """
    if not sys.platform.startswith("linux"):
        return
    if not os.environ.get("DISPLAY"):
        raise NoWindowError("no display (DISPLAY is not set)")
    try:
        x11 = ctypes.CDLL("libX11.so.6")
    except OSError:
        raise NoWindowError("no display (libX11 is not installed)") from None
    x11.XOpenDisplay.restype = ctypes.c_void_p
    display = x11.XOpenDisplay(None)
    if not display:
        raise NoWindowError(f"no display at DISPLAY={os.environ['DISPLAY']}")
    x11.XCloseDisplay(ctypes.c_void_p(display))


class Window:
    """A window of size (width, height) [pixels]; raises NoWindowError where none can be.

    frames limits its life, None: until it is closed.
    """

    FRAME_TIME = 1.0 / 60.0  # simulated time of a frame [s]: a screen's usual rate

    def __init__(self, title: str, size: tuple[int, int], frames: int | None = None):
        check_display()
        self.size, self.frames = size, frames
        self.had_settings = SETTINGS.exists()
        try:
            with silence():
                self.window = ti.ui.Window(f"M-SPH: {title}", size, vsync=True)
        except RuntimeError as error:
            raise NoWindowError(f"no window: {error}") from None
        self.canvas = self.window.get_canvas()
        self.gui = self.window.get_gui()
        self.panel = True
        width, height = size
        self.place = tuple(p / n for p, n in zip(PANEL, (width, height) * 2, strict=True))
        self.paused = False
        self.tilt = [0.0, 0.0]
        self.cursor: Any = np.zeros(2)  # right, up, as shares of the window
        self.grab: np.ndarray | None = None
        self.clock = time.perf_counter()
        self.wall = self.simulated = 0.0  # of a frame [s], smoothed
        self.done = False
        self.marker = ti.Vector.field(2, ti.f32, shape=1)
        self.start: StartScreen | None = StartScreen(size, title, KEYS)
        self.told = -math.inf
        self.tell(0.0, "building the scene")

    def tell(self, share: float, doing: str) -> None:
        """Shows how far the start is, a share (0 to 1), and what is being done. Raises ClosedError
        where someone has closed the window meanwhile."""
        now = time.perf_counter()
        if self.start is None or now - self.told < TELL_PAUSE:
            return
        self.told = now
        for event in self.window.get_events(ti.ui.PRESS):
            self.done = self.done or event.key in QUIT
        if self.done or not self.window.running:
            raise ClosedError
        self.canvas.set_image(self.start.paint(share, doing))
        self.window.show()

    def wants_more(self, show: Show) -> bool:
        over = self.frames is not None and show.frames >= self.frames
        return self.window.running and not self.done and not over

    def controls(self, show: Show) -> Controls:
        wishes = Controls()
        for event in self.window.get_events(ti.ui.PRESS):
            self._press(event.key, wishes)
        step = show.frame_time
        self._hold(show, step)
        cursor = np.array(self.window.get_cursor_pos())
        moved, self.cursor = cursor - self.cursor, cursor
        on_panel = self.panel and _inside(cursor, self.place)
        if self.window.is_pressed(ti.ui.RMB) and not on_panel:
            show.camera.orbit(-moved[0] * ORBIT_PER_WIDTH, -moved[1] * ORBIT_PER_WIDTH)
        pushing = self.window.is_pressed(ti.ui.LMB) and not on_panel
        wishes.hand = self._hand(show, step) if pushing else self._let_go()
        wishes.tilt = (self.tilt[0], self.tilt[1])
        wishes.paused = self.paused
        return wishes

    def _press(self, key: str, wishes: Controls) -> None:
        if key == ti.ui.SPACE:
            self.paused = not self.paused
        elif key == "n":
            wishes.single_step = True
        elif key == "r":
            wishes.reset = True
            self.tilt = [0.0, 0.0]
        elif key == "v":
            wishes.next_view = True
        elif key == "h":
            self.panel = not self.panel
        elif key in QUIT:
            self.done = True

    def _hold(self, show: Show, step: float) -> None:
        """Keys that act as long as they are down."""
        down = self.window.is_pressed
        play = show.scene.play
        rate, limit = math.radians(play.tilt_rate) * step, math.radians(play.tilt_limit)
        roll = down(ti.ui.LEFT) - down(ti.ui.RIGHT)
        pitch = down(ti.ui.DOWN) - down(ti.ui.UP)
        self.tilt[0] = float(np.clip(self.tilt[0] + rate * roll, -limit, limit))
        self.tilt[1] = float(np.clip(self.tilt[1] + rate * pitch, -limit, limit))
        show.camera.orbit(ORBIT_KEY_RATE * step * (down("d") - down("a")), 0.0)
        show.camera.zoom(math.exp(ZOOM_KEY_RATE * step * (down("s") - down("w"))))

    def _hand(self, show: Show, step: float) -> Hand:
        """The ball of water under the cursor goes where the cursor goes.

        It is taken where the cursor's ray meets the water, and dragged at that depth.
        """
        size = show.picture.width, show.picture.height
        i, j = self.cursor * size
        eye, direction = show.camera.box_ray(i, j, *size, show.simulation.size, show.tilt)
        if self.grab is None:
            hit = show.pick(int(i), int(j))
            if hit is None:
                return Hand()
            self.grab = np.asarray(hit)
        axis = show.tilt.T @ -show.camera.axes()[2]
        before = self.grab
        depth = (before - eye) @ axis / (direction @ axis)
        self.grab = eye + depth * direction
        play = show.scene.play
        return Hand(
            position=tuple(self.grab.tolist()),
            velocity=tuple(((self.grab - before) / step).tolist()),
            radius=play.push_radius * max(show.simulation.size),
            grip=play.push_grip,
        )

    def _let_go(self) -> Hand:
        self.grab = None
        return Hand()

    def see(self, show: Show) -> None:
        now = time.perf_counter()
        frame, self.clock = now - self.clock, now
        self.wall = _smooth(self.wall, frame)
        if not self.paused:
            self.simulated = _smooth(self.simulated, show.simulated)
        if self.panel:
            self._draw_panel(show)
        if self.grab is not None:
            self._draw_hand()
        self.canvas.set_image(show.picture.image)
        self.window.show()

    def _draw_hand(self) -> None:
        """A marker under the cursor: GGUI hides it while the left button is down."""
        self.marker[0] = self.cursor.tolist()
        self.canvas.circles(self.marker, radius=MARKER_RADIUS, color=(1.0, 0.95, 0.7))

    def _draw_panel(self, show: Show) -> None:
        rate = self.simulated / self.wall
        with self.gui.sub_window("M-SPH", *self.place):
            self.gui.text(f"{1.0 / self.wall:5.1f} frames/s")
            self.gui.text(f"time {show.simulation.time:6.2f} s  {pace(rate, self.paused)}")
            self.gui.text(f"{sum(show.counts)} particles in {len(show.counts)} layers")
            if show.ledger.entries:
                entry = show.ledger.entries[-1]
                self.gui.text(f"density error {100 * entry.density_error_mean:.2f} %")
                self.gui.text(f"energy {entry.energy:.1f} J")
            self.gui.text(f"view: {show.views.name}")
            for name in sorted(show.stopped):
                self.gui.text(f"{name} stopped: no room")

    def close(self) -> None:
        self.window.destroy()
        if not self.had_settings:
            SETTINGS.unlink(missing_ok=True)


@contextlib.contextmanager
def silence():
    """Keeps what libraries print past Python from the terminal: we say it in our own line."""
    saved = [os.dup(fd) for fd in (1, 2)]
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        for fd in (1, 2):
            os.dup2(nowhere, fd)
        yield
    finally:
        for fd, copy in zip((1, 2), saved, strict=True):
            os.dup2(copy, fd)
            os.close(copy)
        os.close(nowhere)


def pace(rate: float, paused: bool) -> str:
    """In words, how fast time goes: simulated over wall-clock time (-)."""
    slow = "" if rate > REAL_TIME else " slow motion"
    return f"x{rate:.2f}" + (" paused" if paused else slow)


def _smooth(past: float, now: float) -> float:
    """A running mean; the first value stands for itself."""
    return now if past == 0.0 else SMOOTHING * past + (1.0 - SMOOTHING) * now


def _inside(point: np.ndarray, panel: tuple[float, ...]) -> bool:
    """Whether the point (right, up) lies on the panel, whose y runs down from the top."""
    x, y, width, height = panel
    return x <= point[0] <= x + width and y <= 1.0 - point[1] <= y + height
