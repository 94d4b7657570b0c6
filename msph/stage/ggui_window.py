"""Window implemented with GGUI, Taichi's window library."""

import contextlib
import math
import os
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import taichi as ti

from msph.picture.pixels import pack
from msph.stage.keys import ACTIONS, KEYS
from msph.stage.lost_display import DisplayGuard
from msph.stage.start_screen import StartScreen
from msph.stage.window import ARROWS, BUTTONS, ClosedError, NoWindowError, check_display
from msph.stage.x11_pointer import X11Pointer
from msph.taichi_internals import set_image

TITLE = "M-SPH"  # title, by which the window is found on the X server
MARKER_RADIUS = 0.008  # radius of the cursor's marker over the window's height
# Line width of arrows over the window's height; length of a tip over the arrow's length.
STROKE, TIP = 0.006, 0.22
# Least time between two progress reports [s]: each takes milliseconds to display.
REPORT_INTERVAL = 0.1
# File that GGUI writes to the working directory; removed if it is new.
SETTINGS = Path("imgui.ini")

# Keys on the start screen, and their effects.
FIRST_KEYS = tuple((key.label, key.effect) for key in KEYS if key.hint)


class Window:
    """Window of GGUI of size (width, height) [pixels]. Positions are (right, up) in shares of it.
    keys: keys and their effects on the start screen. Raises NoWindowError."""

    def __init__(
        self, title: str, size: tuple[int, int], keys: tuple[tuple[str, str], ...] = FIRST_KEYS
    ):
        check_display()
        self.size = size
        self.had_settings = SETTINGS.exists()
        try:
            with silence():
                self.window = ti.ui.Window(TITLE, size, vsync=True)
        except RuntimeError as error:
            raise NoWindowError(f"no window: {error}") from None
        self.pointer = X11Pointer(TITLE) if sys.platform.startswith("linux") else None
        self.pressed_at: Any = None  # GGUI's cursor at a press until it moves
        self.guard = DisplayGuard()
        self.canvas = self.window.get_canvas()
        self.marked, self.arrowed = False, 0  # marker and number of arrows on the next image
        self.marker = ti.Vector.field(2, ti.f32, shape=1)
        self.lines = [ti.Vector.field(2, ti.f32, shape=6) for _ in ARROWS]
        self.words = np.zeros(size, np.int32)  # packed pixels of the image
        self.keys, self.waiting = keys, list[str]()  # waiting: presses for the next presses()
        self.begin(title)

    def begin(self, title: str) -> None:
        """Shows the start screen with the title of a scene until the next image."""
        self.start, self.reported = StartScreen(self.size, title, self.keys), -math.inf
        self.report("building the scene")

    def report(self, doing: str) -> None:
        """Shows a progress message on the start screen, unless it is within REPORT_INTERVAL of
        another one. Raises ClosedError if the user has pressed quit or closed the window; other
        keys are kept for the next presses()."""
        now = time.perf_counter()
        if now - self.reported < REPORT_INTERVAL:
            return
        self.reported = now
        self.waiting = self.presses()
        if not self.open or any(ACTIONS.get(key) == "quit" for key in self.waiting):
            raise ClosedError
        if self.waiting:
            doing += f"; then: {', '.join(key.strip() or 'space' for key in self.waiting)}"
        self.show(self.start.paint(doing))

    @property
    def open(self) -> bool:
        """True until the user closes the window."""
        return self.window.running

    def presses(self) -> list[str]:
        """Returns the keys and buttons pressed since the last call."""
        pressed = [event.key for event in self.window.get_events(ti.ui.PRESS)]
        if any(button in pressed for button in BUTTONS):
            self.pressed_at = self.window.get_cursor_pos()
            if self.pointer:
                self.pointer.press()
        pressed, self.waiting = [*self.waiting, *pressed], []
        return pressed

    def down(self, *keys: str) -> bool:
        """Returns True if any of these keys and buttons is down."""
        return self.window.is_pressed(*keys)

    @property
    def aspect(self) -> float:
        """Width over height on the screen; differs from the image's after a resize."""
        width, height = self.window.get_window_shape()
        return width / max(height, 1)

    def cursor(self) -> np.ndarray:
        """Returns the position of the cursor, (2,)."""
        cursor = self.window.get_cursor_pos()
        if cursor != self.pressed_at:
            self.pressed_at = None
        elif self.pointer and (place := self.pointer.position()):
            width, height = self.window.get_window_shape()
            return np.array([place[0] / width, 1.0 - place[1] / height])
        return np.array(cursor)

    def mark(self, cursor: np.ndarray) -> None:
        """Draws a marker on the next image: GGUI hides the cursor while the left button is down."""
        self.marker[0] = cursor.tolist()
        self.marked = True

    def arrows(self, places: np.ndarray) -> None:
        """Draws arrows on the next image; places: begin and end of each, (k, 2, 2)."""
        for k, (begin, end) in enumerate(places[: len(ARROWS)]):
            along = end - begin
            aside = np.array([-along[1], along[0]])
            tips = [end - TIP * (along + s * 0.6 * aside) for s in (-1.0, 1.0)]
            line = np.array([begin, end, end, tips[0], end, tips[1]], np.float32)
            self.lines[k].from_numpy(line)
        self.arrowed = len(places)

    def show(self, image: ti.Field | np.ndarray) -> None:
        """Presents an image with marker and arrows, and waits for the display. image: an Image
        (msph.picture.pixels), or packed pixels (width, height) int32; index [right, up]."""
        if isinstance(image, np.ndarray):
            self.words = image
        else:
            pack(image.field, self.words)
        set_image(self.canvas, self.words)
        if self.marked:
            self.canvas.circles(self.marker, radius=MARKER_RADIUS, color=(1.0, 0.95, 0.7))
        for line, colour in zip(self.lines[: self.arrowed], ARROWS, strict=False):
            self.canvas.lines(line, width=STROKE, color=colour)
        self.marked, self.arrowed = False, 0
        # Taichi prints a message before it aborts.
        with silence():
            self.window.show()

    def again(self) -> None:
        """Shows the last image again."""
        self.show(self.words)

    def close(self) -> None:
        if self.pointer:
            self.pointer.close()
        self.window.destroy()
        self.guard.close()
        if not self.had_settings:
            SETTINGS.unlink(missing_ok=True)


@contextlib.contextmanager
def silence() -> Iterator[None]:
    """Context that discards what native libraries print on stdout and stderr."""
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
