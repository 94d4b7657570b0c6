"""The window as a water sees it that runs in a process of its own."""

import contextlib
import math
import time
from collections.abc import Iterator
from multiprocessing.connection import Connection

import numpy as np
import taichi as ti

from msph.picture.pixels import pack
from msph.stage.choice import Choice
from msph.stage.link import FromWater, Input, Picture, Progress, Wanted
from msph.stage.window import TELL_PAUSE, ClosedError


class RemoteWindow:
    """A Window at the other end of a link; pixels: memory shared with it, a word for each pixel.

    A picture is shown while the next is computed: at most one waits. Raises ClosedError where the
    window is closed before it says anything.
    """

    def __init__(self, link: Connection, pixels, size: tuple[int, int]):
        self.link, self.size = link, size
        self.pixels = np.frombuffer(pixels, np.int32).reshape(size)
        self.open, self.sent, self.told = True, 0, -math.inf
        self.pressed: list[str] = []
        self.marker: np.ndarray | None = None
        self.arrowed: np.ndarray | None = None
        self.input = Input((), frozenset(), np.zeros(2), size[0] / size[1], 0)
        self._receive(wait=True)
        if not self.open:
            raise ClosedError

    def tell(self, share: float, doing: str) -> None:
        now = time.perf_counter()
        if now - self.told < TELL_PAUSE:
            return
        self.told = now
        self._send(Progress(share, doing))
        self._receive()
        if not self.open:
            raise ClosedError

    def ask(self, choice: Choice) -> None:
        """Asks for another water in this one's place."""
        self._send(Wanted(choice))

    def notice(self) -> str:
        return self.input.notice

    @property
    def display(self) -> float:
        """Processor time that the display takes for a picture [s]."""
        return self.input.display

    def presses(self) -> list[str]:
        self._receive()
        pressed, self.pressed = self.pressed, []
        return pressed

    def down(self, *keys: str) -> bool:
        return any(key in self.input.held for key in keys)

    @property
    def aspect(self) -> float:
        return self.input.aspect

    def cursor(self) -> np.ndarray:
        return self.input.cursor.copy()

    def mark(self, cursor: np.ndarray) -> None:
        self.marker = cursor

    def arrows(self, places: np.ndarray) -> None:
        self.arrowed = places

    def show(self, image: ti.Field) -> None:
        while self.open and self.input.shown < self.sent:
            self._receive(wait=True)
        pack(image, self.pixels)
        self._send(Picture(self.marker, self.arrowed))
        self.sent += 1
        self.marker = self.arrowed = None

    def _send(self, message: FromWater) -> None:
        with self._closing():
            self.link.send(message)

    def _receive(self, wait: bool = False) -> None:
        """Takes what the window has said; wait: for something, if there is nothing yet."""
        with self._closing():
            while wait or self.link.poll():
                wait = False
                self.input = self.link.recv()
                self.pressed += self.input.presses

    @contextlib.contextmanager
    def _closing(self) -> Iterator[None]:
        """A link whose other end is gone is a window that was closed."""
        try:
            yield
        except (EOFError, OSError):
            self.open = False
