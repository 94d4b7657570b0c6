"""Position of the mouse pointer from the X server, where GGUI does not report it.

GLFW 3.3, which GGUI uses, reads the pointer's position when a button is pressed, and does not
report a motion to that position: after a press and one jump, GGUI's cursor stays where it was.
"""

import ctypes
import os
from ctypes import POINTER, byref, c_char_p, c_int, c_long, c_uint, c_ulong, c_void_p
from typing import Any

# Property with the process of a window, and its type.
PROCESS, CARDINAL = b"_NET_WM_PID", 6


class X11Pointer:
    """Mouse pointer over the window of this process with a title; has its own X connection."""

    def __init__(self, title: str):
        self.x11 = ctypes.CDLL("libX11.so.6")
        self.x11.XOpenDisplay.restype = c_void_p
        self.x11.XDefaultRootWindow.restype = self.x11.XInternAtom.restype = c_ulong
        self.display = c_void_p(self.x11.XOpenDisplay(None))
        self.process = c_ulong(self.x11.XInternAtom(self.display, PROCESS, 0))
        # Windows of other programs may vanish during the search, which is no error here.
        ignore = ctypes.CFUNCTYPE(c_int, c_void_p, c_void_p)(lambda *_: 0)
        self.x11.XSetErrorHandler.restype = c_void_p
        before = self.x11.XSetErrorHandler(ignore)
        root = self.x11.XDefaultRootWindow(self.display)
        self.window = self._find(root, title.encode())
        self.x11.XSetErrorHandler(c_void_p(before))

    def position(self) -> tuple[int, int] | None:
        """Returns the position (right, down) [pixels from the window's corner], None if unknown."""
        if not self.window:
            return None
        root, child, mask = c_ulong(), c_ulong(), c_uint()
        absolute, place = (c_int(), c_int()), (c_int(), c_int())
        numbers = [byref(n) for n in (*absolute, *place)]
        found = self.x11.XQueryPointer(
            self.display, c_ulong(self.window), byref(root), byref(child), *numbers, byref(mask)
        )
        return (place[0].value, place[1].value) if found else None

    def close(self) -> None:
        self.x11.XCloseDisplay(self.display)

    def _find(self, window: int, title: bytes) -> int:
        """Returns the window of this process with this title in a window's tree, 0 for none."""
        if self._owner(window) == os.getpid() and self._title(window) == title:
            return window
        root, parent, number = c_ulong(), c_ulong(), c_uint()
        children = POINTER(c_ulong)()
        found: Any = self.x11.XQueryTree(
            self.display,
            c_ulong(window),
            byref(root),
            byref(parent),
            byref(children),
            byref(number),
        )
        below = children[: number.value] if found and children else []
        if children:
            self.x11.XFree(children)
        return next((w for w in (self._find(child, title) for child in below) if w), 0)

    def _title(self, window: int) -> bytes | None:
        name = c_char_p()
        self.x11.XFetchName(self.display, c_ulong(window), byref(name))
        return name.value

    def _owner(self, window: int) -> int:
        """Returns the process of a window, 0 if unknown."""
        kind, size, number, left = c_ulong(), c_int(), c_ulong(), c_ulong()
        data = POINTER(c_ulong)()
        self.x11.XGetWindowProperty(
            self.display,
            c_ulong(window),
            self.process,
            c_long(0),
            c_long(1),
            0,
            c_ulong(CARDINAL),
            byref(kind),
            byref(size),
            byref(number),
            byref(left),
            byref(data),
        )
        owner = data[0] if data and number.value else 0
        if data:
            self.x11.XFree(data)
        return int(owner)
