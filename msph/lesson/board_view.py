"""Image of a board above the lesson's band, and the window loop of its lesson."""

from typing import Any

import numpy as np
import taichi as ti

from msph.lesson.course import LessonProgress
from msph.lesson.guide import Guide
from msph.picture.pixels import Image
from msph.stage.ggui_window import Window
from msph.stage.keys import ACTIONS


class BoardView:
    """Image of a lesson's board, redrawn when the inputs change; the lowest `below` pixels are left
    free for the band."""

    def __init__(self, size: tuple[int, int], below: int):
        self.size, self.below = size, below
        self.image = Image(ti.Vector.field(3, ti.f32, size), *size)
        self.drawn: Any = None
        self.pixels: Any = None  # (height, width, 3) uint8, first row at the top

    def draw(self, progress: LessonProgress) -> None:
        if self.drawn != progress.values:
            self.drawn = dict(progress.values)
            size = self.size[0], self.size[1] - self.below
            self.pixels = progress.board.draw(self.drawn, size)
        # Copied in each frame, as the lesson's pages are drawn over the image.
        whole = np.zeros((*self.size, 3), np.float32)
        whole[:, self.below :] = self.pixels[::-1].transpose(1, 0, 2) / np.float32(255.0)
        self.image.field.from_numpy(whole)


def read(window: Window, guide: Guide, frames: int | None = None) -> None:
    """Shows a board and its lesson until the window is closed or after `frames` frames."""
    view, done = BoardView(window.size, guide.below), 0
    while window.open and (frames is None or done < frames):
        pressed = window.presses()
        for key in pressed:
            if not guide.handle_key(key) and ACTIONS.get(key) == "quit":
                return
        guide.drag(window.cursor(), window.down("LMB"), "LMB" in pressed)
        guide.update()
        view.draw(guide.progress)
        guide.draw(view.image)
        window.show(view.image)
        done += 1
