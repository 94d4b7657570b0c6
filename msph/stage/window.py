"""The window: GGUI shows pictures and brings keys and mouse."""

import contextlib
import ctypes
import math
import os
import sys
import time
from pathlib import Path

import numpy as np
import taichi as ti

from msph.stage.controls import ACTIONS, KEYS
from msph.stage.start_screen import StartScreen

MARKER_RADIUS = 0.008  # of the marker under a pushing cursor, as a share of the window's height
# Colours of arrows, in their order; width of their lines, over the window's height, and length of a
# tip over that of its arrow.
ARROWS, STROKE, TIP = ((1.0, 0.82, 0.4), (0.34, 0.71, 0.91)), 0.006, 0.22
# GGUI writes the places of its own panels here, unasked, where the program runs.
SETTINGS = Path("imgui.ini")
# Least time between two pictures of the start [s]: each takes some milliseconds from compiling.
TELL_PAUSE = 0.12


# Keys that are told while the first frame is prepared, and what they do.
FIRST = tuple((key.shown, key.does) for key in KEYS if key.hint)


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
    """A window of size (width, height) [pixels]; keys: those told until its first frame, and what
    they do. Raises NoWindowError where none can be."""

    def __init__(
        self, title: str, size: tuple[int, int], keys: tuple[tuple[str, str], ...] = FIRST
    ):
        check_display()
        self.size = size
        self.had_settings = SETTINGS.exists()
        try:
            with silence():
                self.window = ti.ui.Window(f"M-SPH: {title}", size, vsync=True)
        except RuntimeError as error:
            raise NoWindowError(f"no window: {error}") from None
        self.canvas = self.window.get_canvas()
        self.closing = False
        self.marked, self.arrowed = False, 0  # what lies over the next picture
        self.marker = ti.Vector.field(2, ti.f32, shape=1)
        self.lines = [ti.Vector.field(2, ti.f32, shape=6) for _ in ARROWS]
        self.start = StartScreen(size, title, keys)
        self.told = -math.inf
        self.tell(0.0, "building the scene")

    def tell(self, share: float, doing: str) -> None:
        """Shows how far the start is, a share (0 to 1), and what is being done. Raises ClosedError
        where someone has closed the window meanwhile."""
        now = time.perf_counter()
        if now - self.told < TELL_PAUSE:
            return
        self.told = now
        if any(ACTIONS.get(key) == "quit" for key in self.presses()):
            self.closing = True
        if not self.open:
            raise ClosedError
        self.canvas.set_image(self.start.paint(share, doing))
        self.window.show()

    @property
    def open(self) -> bool:
        """Whether nobody has closed it."""
        return self.window.running and not self.closing

    def presses(self) -> list[str]:
        """Keys and buttons that went down since the last call."""
        return [event.key for event in self.window.get_events(ti.ui.PRESS)]

    def down(self, *keys: str) -> bool:
        """Whether any of these keys and buttons is down."""
        return self.window.is_pressed(*keys)

    @property
    def aspect(self) -> float:
        """Width over height as the screen shows it, whatever the pictures' size."""
        width, height = self.window.get_window_shape()
        return width / max(height, 1)

    def cursor(self) -> np.ndarray:
        """Right, up, as shares of the window."""
        return np.array(self.window.get_cursor_pos())

    def mark(self, cursor: np.ndarray) -> None:
        """A marker in the next picture: GGUI hides the cursor while the left button is down."""
        self.marker[0] = cursor.tolist()
        self.marked = True

    def arrows(self, places: np.ndarray) -> None:
        """Lines with a tip in the next picture: from and to, (k, 2, 2), in shares of the window."""
        for k, (begin, end) in enumerate(places[: len(ARROWS)]):
            along = end - begin
            aside = np.array([-along[1], along[0]])
            tips = [end - TIP * (along + s * 0.6 * aside) for s in (-1.0, 1.0)]
            line = np.array([begin, end, end, tips[0], end, tips[1]], np.float32)
            self.lines[k].from_numpy(line)
        self.arrowed = len(places)

    def show(self, image: ti.Field) -> None:
        """Shows an image under marker and arrows, and waits for the screen."""
        self.canvas.set_image(image)
        if self.marked:
            self.canvas.circles(self.marker, radius=MARKER_RADIUS, color=(1.0, 0.95, 0.7))
        for line, colour in zip(self.lines[: self.arrowed], ARROWS, strict=False):
            self.canvas.lines(line, width=STROKE, color=colour)
        self.marked, self.arrowed = False, 0
        self.window.show()

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
