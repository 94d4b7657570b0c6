"""Position of the mouse pointer from the X server, where GGUI does not report it.

GLFW 3.3, which GGUI uses, reads the pointer's position when a button is pressed, and does not
report a motion to that position: after a press and one jump, GGUI's cursor stays where it was.
"""

import ctypes
from ctypes import byref, c_char_p, c_int, c_uint, c_ulong, c_void_p


class X11Pointer:
    """Mouse pointer over the window whose title begins with `title`; has its own X connection."""

    def __init__(self, title: str):
        self.x11, self.title = ctypes.CDLL("libX11.so.6"), title.encode()
        self.x11.XOpenDisplay.restype = c_void_p
        self.x11.XDefaultRootWindow.restype = c_ulong
        self.display = c_void_p(self.x11.XOpenDisplay(None))
        self.window = 0  # under the pointer at the last press, 0 for a window of another title

    def press(self) -> None:
        """Finds the window under the pointer, which has just pressed a button on it."""
        self.window, below = 0, self.x11.XDefaultRootWindow(self.display)
        while below:
            self.window, (below, *_) = below, self._query(below)
        name = c_char_p()
        self.x11.XFetchName(self.display, c_ulong(self.window), byref(name))
        # GGUI appends the frame rate.
        self.window *= (name.value or b"").startswith(self.title)

    def position(self) -> tuple[int, int] | None:
        """Returns the position (right, down) [pixels from the window's corner], None if unknown."""
        return self._query(self.window)[1:] if self.window else None

    def close(self) -> None:
        self.x11.XCloseDisplay(self.display)

    def _query(self, window: int) -> tuple[int, int, int]:
        """Returns the window under the pointer among the children of a window, 0 for none, and the
        pointer's position in the window [pixels]."""
        root, child, mask, places = c_ulong(), c_ulong(), c_uint(), [c_int() for _ in range(4)]
        found = byref(root), byref(child), *map(byref, places), byref(mask)
        self.x11.XQueryPointer(self.display, c_ulong(window), *found)
        return child.value, places[2].value, places[3].value
