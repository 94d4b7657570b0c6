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
from msph.stage.pacer import Pacer
from msph.stage.show import Show
from msph.stage.start_screen import StartScreen

ORBIT_PER_WIDTH = math.radians(200.0)  # a drag across the whole window turns the view so far
ORBIT_KEY_RATE = math.radians(70.0)  # [rad/s]
ZOOM_KEY_RATE = 1.5  # [1/s], as the logarithm of the distance
PANEL = (10.0, 10.0, 290.0, 170.0)  # left, top, width, height of the panel [pixels]
SETTINGS = Path("imgui.ini")  # where the panel's library leaves its state, unasked
MARKER_RADIUS = 0.008  # of the marker under a pushing cursor, as a share of the window's height
QUIT = ("q", ti.ui.ESCAPE)  # keys that close the window
REAL_TIME = 0.95  # simulated over wall-clock time that passes for what was asked for
SLOW_MOTION = 0.1  # simulated over wall-clock time in slow motion
FORGET = 1.01  # growth per frame of the least time that showing a frame takes
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

    fps: frames per second to hold. frames limits its life, None: until it is closed.
    """

    def __init__(
        self, title: str, size: tuple[int, int], fps: float = 60.0, frames: int | None = None
    ):
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
        self.pacer = Pacer(fps)
        self.quality = ""  # what the scene is at, for the panel
        self.clock: float | None = None  # when the last frame had been shown [s]
        self.shown = math.inf  # what showing a frame takes at least [s]: beyond, it waits
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
        self.pacer.steer(wishes)
        step = self.pacer.frame_time
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
        elif key == "m":
            self.pacer.ask(SLOW_MOTION if self.pacer.speed == 1.0 else 1.0)
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
        wall = self.pacer.wall
        show.camera.orbit(ORBIT_KEY_RATE * wall * (down("d") - down("a")), 0.0)
        show.camera.zoom(math.exp(ZOOM_KEY_RATE * wall * (down("s") - down("w"))))

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
        self.start = None
        if self.panel:
            self._draw_panel(show)
        if self.grab is not None:
            self._draw_hand()
        begin = time.perf_counter()
        self.canvas.set_image(show.picture.image)
        self.window.show()
        now = time.perf_counter()
        self.shown = min(FORGET * self.shown, now - begin)
        if self.clock is not None and not self.paused:
            self.pacer.see(show, now - self.clock, self.shown)
        self.clock = now

    def _draw_hand(self) -> None:
        """A marker under the cursor: GGUI hides it while the left button is down."""
        self.marker[0] = self.cursor.tolist()
        self.canvas.circles(self.marker, radius=MARKER_RADIUS, color=(1.0, 0.95, 0.7))

    def _draw_panel(self, show: Show) -> None:
        pacer = self.pacer
        with self.gui.sub_window("M-SPH", *self.place):
            self.gui.text(f"{1.0 / pacer.wall:5.1f} frames/s")
            time_told = pace(pacer.pace, pacer.speed, self.paused)
            self.gui.text(f"time {show.simulation.time:6.2f} s  {time_told}")
            layers = len(show.counts)
            self.gui.text(f"{sum(show.counts)} particles in {layers} layer{'s' * (layers > 1)}")
            self.gui.text(f"quality {self.quality}")
            if show.ledger.entries:
                error = show.ledger.last_density_error()
                self.gui.text(f"density error {100 * error:.2f} %")
                self.gui.text(f"energy {show.ledger.entries[-1].energy:.1f} J")
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


def pace(rate: float, speed: float, paused: bool) -> str:
    """In words, how fast time goes: simulated over wall-clock time (-), and what was asked for."""
    if paused:
        return f"x{rate:.2f} paused"
    if rate < REAL_TIME * speed:
        return f"x{rate:.2f}: this machine is too slow for more"
    return f"x{rate:.2f}" + (" slow motion" if speed < 1.0 else "")


def _inside(point: np.ndarray, panel: tuple[float, ...]) -> bool:
    """Whether the point (right, up) lies on the panel, whose y runs down from the top."""
    x, y, width, height = panel
    return x <= point[0] <= x + width and y <= 1.0 - point[1] <= y + height
