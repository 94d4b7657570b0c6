"""Overlay of a lesson in a window: keys, sliders, and pages over the image."""

import time

import numpy as np

from msph.lesson.boards import board_of
from msph.lesson.course import Progress
from msph.lesson.load import Course
from msph.lesson.paint import LETTERS, Band, Reasons, band_height
from msph.picture.overlay import Overlay
from msph.scene.parameters import parameters
from msph.scene.schema import Scene
from msph.stage.pages import text_height
from msph.stage.row import Row
from msph.stage.widgets import Grip, Slider

# Elapsed time between updates of the displayed numbers [s], slow enough to be read.
UPDATE_INTERVAL = 0.25
# Keys of the lesson, and keys of the player that a lesson disables, as they change the scene.
PAGE_KEYS, DISABLED_KEYS = ("n", "b", "r"), ("Tab", "BackSpace", "i", "k", "o")


def units_of(course: Course) -> dict[str, str]:
    """Returns the units of the sliders by name."""
    if course.lesson.board:
        inputs = board_of(course.lesson.board).INPUTS
        return {name: given.unit for name, given in inputs.items()}
    known = {p.key: p.unit for p in parameters(Scene)}
    return {s.name: known[s.key] for s in course.lesson.slider}


class Guide:
    """Overlay of a lesson. row: its simulations, None for a board; size (width, height) of the
    window [pixels]; progress: see Progress."""

    def __init__(self, course: Course, row: Row | None, size: tuple[int, int]):
        self.size, self.text = size, text_height(size[1])
        self.reasons = Reasons(course.lesson, course.code, size, self.text)
        self.progress = Progress(course, row, self.reasons.pages)
        self.below = band_height(self.text)
        self.band = Band((size[0], self.below), self.text, units_of(course))
        self.overlay = Overlay(*size, {"band": (size[0], self.below), "why": size})
        self.painted: object = None
        self.read, self.shown = -np.inf, list[str]()
        self.grip = Grip()

    taken = frozenset((*PAGE_KEYS, *DISABLED_KEYS))

    @property
    def runs(self) -> int:
        """Number of restarts."""
        return self.progress.runs

    @property
    def pauses(self) -> bool:
        """True while the simulations are paused."""
        return self.progress.pauses

    @property
    def is_full_page(self) -> bool:
        """True if a page covers the whole image."""
        return self.progress.page > len(self.progress.lesson.do)

    def handle_key(self, key: str) -> bool:
        """Handles a pressed key and returns True if it belongs to the lesson."""
        progress = self.progress
        if progress.page == 0 and key in LETTERS:
            progress.answer(LETTERS.index(key) + 1)
        elif key in ("n", "b"):
            if progress.go(1 if key == "n" else -1):
                self.read = -np.inf
        elif key == "r" and progress.task:
            progress.again()
        else:
            return key in self.taken or (self.is_full_page and key == "h")
        return True

    def is_on_page(self, cursor: np.ndarray) -> bool:
        """Returns True if the cursor, (right, up) in shares of the window, is on a page."""
        return self.is_full_page or bool(cursor[1] * self.size[1] < self.below)

    def drag(self, cursor: np.ndarray, down: bool) -> bool:
        """Moves the slider on which the left button was pressed; returns True while it is held."""
        x, y = cursor[0] * self.size[0], (1.0 - cursor[1]) * self.size[1]
        y -= self.size[1] - self.below
        moved = self.grip.act(self.band.sheet if self.progress.task else None, x, y, down)
        if isinstance(moved, Slider):
            sliders = {s.name: s for s in self.progress.lesson.slider}
            self.progress.move(sliders[moved.name], moved.value(x))
        return self.grip.holds

    def update(self) -> None:
        """Updates the task and its displayed numbers after a frame."""
        self.progress.update()
        now = time.perf_counter()
        if now - self.read > UPDATE_INTERVAL:
            self.read, self.shown = now, self.progress.shown()

    def draw(self, image) -> None:
        """Draws the current page over the image."""
        p = self.progress
        state = (p.page, p.answered, tuple(p.ticked), tuple(p.values.values()), tuple(self.shown))
        if state != self.painted:
            self.painted = state
            self.overlay.hide("why")
            if self.is_full_page:
                page = self.reasons.paint(p.page - 1 - len(p.lesson.do), p)
                self.overlay.put("why", page, 0, 0)
            else:
                page = self.band.paint(p, self.shown)
                self.overlay.put("band", page, 0, self.size[1] - self.below)
        self.overlay.draw(image)
