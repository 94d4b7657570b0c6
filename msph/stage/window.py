"""Interface of a window, and a check that a window can be opened."""

import ctypes
import os
import sys
from typing import Any, Protocol

import numpy as np

# Buttons of the mouse.
BUTTONS = ("LMB", "RMB", "MMB")
# Colours of the arrows, in order.
ARROWS = ((1.0, 0.82, 0.4), (0.34, 0.71, 0.91))
# Least time between two progress reports [s]: each takes milliseconds to display.
REPORT_INTERVAL = 0.1


class NoWindowError(RuntimeError):
    """No window can be opened, for the reason in the message."""


class ClosedError(Exception):
    """The user closed the window, or pressed quit, during the preparation of a scene."""


class Window(Protocol):
    """A window of size (width, height) [pixels]. Positions are (right, up) in shares of it."""

    @property
    def size(self) -> tuple[int, int]: ...

    @property
    def open(self) -> bool:
        """True until the user closes the window."""

    @property
    def aspect(self) -> float:
        """Width over height on the screen; differs from the image's after a resize."""

    def presses(self) -> list[str]:
        """Returns the keys and buttons pressed since the last call."""

    def down(self, *keys: str) -> bool:
        """Returns True if any of these keys and buttons is down."""

    def cursor(self) -> np.ndarray:
        """Returns the position of the cursor, (2,)."""

    def mark(self, cursor: np.ndarray) -> None:
        """Draws a marker on the next image."""

    def arrows(self, places: np.ndarray) -> None:
        """Draws arrows on the next image; places: begin and end of each, (k, 2, 2)."""

    def begin(self, title: str) -> None:
        """Shows the start screen with the title of a scene until the next image."""

    def report(self, doing: str, important: bool = False) -> None:
        """Shows a progress message on the start screen; within REPORT_INTERVAL of another one only
        if it is `important`. Raises ClosedError if the user has pressed quit or closed the window;
        other keys are kept for the next presses()."""

    def again(self) -> None:
        """Shows the last image again."""

    def show(self, image: Any) -> None:
        """Presents an image with marker and arrows, and waits for the display. image: an Image
        (msph.picture.pixels), or packed pixels (width, height) int32; index [right, up]."""


def check_display() -> None:
    """Raises NoWindowError on Linux without an X server, where GGUI would end the process."""
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
