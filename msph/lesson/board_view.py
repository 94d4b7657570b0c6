"""Image of a board above the lesson's band."""

from typing import Any

import numpy as np
import taichi as ti

from msph.lesson.course import Progress
from msph.picture.pixels import Image


class BoardView:
    """image: the board of a lesson, redrawn when its inputs change; the lowest `below` pixels are
    left free for the band."""

    def __init__(self, size: tuple[int, int], below: int):
        self.size, self.below = size, below
        self.image = Image(ti.Vector.field(3, ti.f32, size), *size)
        self.drawn: Any = None
        self.pixels: Any = None  # (height, width, 3) uint8, first row at the top

    def draw(self, progress: Progress) -> None:
        if self.drawn != progress.values:
            self.drawn = dict(progress.values)
            size = self.size[0], self.size[1] - self.below
            self.pixels = progress.board.draw(self.drawn, size)
        # Copied in each frame, as the lesson's pages are drawn over the image.
        whole = np.zeros((*self.size, 3), np.float32)
        whole[:, self.below :] = self.pixels[::-1].transpose(1, 0, 2) / np.float32(255.0)
        self.image.field.from_numpy(whole)
