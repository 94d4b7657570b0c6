"""Interface of a window, and whether one can be opened here."""

import ctypes
import os
import sys
from typing import Any, Protocol

import numpy as np

# Colours of arrows, in their order.
ARROWS = ((1.0, 0.82, 0.4), (0.34, 0.71, 0.91))
# Least time between two reports of what is being done [s]: each takes milliseconds to be shown.
REPORT_INTERVAL = 0.12


class NoWindowError(RuntimeError):
    """No window can be opened here; the text says why."""


class ClosedError(Exception):
    """The window was closed, or a key asked to quit, while something was prepared in it."""


class Window(Protocol):
    """A window of size (width, height) [pixels]. Places in it are (right, up), as shares of it."""

    @property
    def size(self) -> tuple[int, int]: ...

    @property
    def open(self) -> bool:
        """True until the user closes the window."""

    @property
    def aspect(self) -> float:
        """Width over height as the screen shows it, whatever the pictures' size."""

    def presses(self) -> list[str]:
        """Keys and buttons that went down since the last call."""

    def down(self, *keys: str) -> bool:
        """Whether any of these keys and buttons is down."""

    def cursor(self) -> np.ndarray:
        """Its place, (2,)."""

    def mark(self, cursor: np.ndarray) -> None:
        """A marker at a place in the next picture."""

    def arrows(self, places: np.ndarray) -> None:
        """Lines with a tip in the next picture: from and to, (k, 2, 2)."""

    def begin(self, title: str) -> None:
        """Shows the start screen of a scene with this title, until the next image."""

    def report(self, doing: str) -> None:
        """Shows on the start screen what is being done. Raises ClosedError if the user has asked to
        quit or closed the window meanwhile; other keys wait for the next presses()."""

    def again(self) -> None:
        """Shows the last image again."""

    def show(self, image: Any) -> None:
        """Shows an image under marker and arrows, and waits for the screen: an Image
        (msph.picture.pixels), or its packed pixels (width, height) int32; index [right, up]."""


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
