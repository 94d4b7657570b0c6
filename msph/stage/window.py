"""What a window shares with its users, and a check that a window can be opened."""

import ctypes
import os
import sys

# Buttons of the mouse.
BUTTONS = ("LMB", "RMB", "MMB")
# Colours of the arrows, in order.
ARROWS = ((1.0, 0.82, 0.4), (0.34, 0.71, 0.91))


class NoWindowError(RuntimeError):
    """No window can be opened, for the reason in the message."""


class ClosedError(Exception):
    """The user closed the window, or pressed quit, during the preparation of a scene."""


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
