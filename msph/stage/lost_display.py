"""Handling of a lost display: prints one line, completes recordings, ends with exit code 1.

By default, Xlib ends the process after an I/O error, and Taichi's window aborts the process with
exit code 134 after the window was destroyed; neither returns to Python.
"""

import contextlib
import ctypes
import os
import signal
import sys
from collections.abc import Callable, Iterator

EXIT_CODE = 1
LINE = b"msph: the display or the window was lost\n"

# Functions that complete a recording in progress.
_completions: list[Callable[[], None]] = []


@contextlib.contextmanager
def completing(complete: Callable[[], None]) -> Iterator[None]:
    """Context in which a lost display calls `complete` before the program ends."""
    _completions.append(complete)
    try:
        yield
    finally:
        _completions.remove(complete)


class DisplayGuard:
    """Handler of lost displays, from its creation until close(). Has an effect on Linux only."""

    def __init__(self) -> None:
        self.stderr = os.dup(2)
        # ctypes does not keep callbacks alive.
        self.callbacks = [
            ctypes.CFUNCTYPE(None, ctypes.c_int)(self._end),
            ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p)(self._end),
            ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p)(self._end),
        ]
        self._install(*self.callbacks)

    def _install(self, abort=None, io_error=None, error=None) -> None:
        if not sys.platform.startswith("linux"):
            return
        # A Python handler of SIGABRT would run after abort(), that is never.
        libc, x11 = ctypes.CDLL(None), ctypes.CDLL("libX11.so.6")
        libc.signal(signal.SIGABRT, abort or ctypes.c_void_p(signal.SIG_DFL))
        x11.XSetIOErrorHandler(io_error)
        x11.XSetErrorHandler(error)

    def _end(self, *_) -> int:
        os.write(self.stderr, LINE)
        for complete in _completions:
            with contextlib.suppress(Exception):
                complete()
        os._exit(EXIT_CODE)

    def close(self) -> None:
        self._install()
        os.close(self.stderr)
