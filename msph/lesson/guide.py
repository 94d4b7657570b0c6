"""Overlay of a lesson in a window: keys, sliders, and pages over the image."""

import time
from functools import partial

import numpy as np

from msph.lesson.course import LessonProgress
from msph.lesson.load import Course
from msph.lesson.paint import LETTERS, Reasons, TaskBar, band_height
from msph.picture.overlay import Overlay
from msph.stage.input_overlay import InputOverlay
from msph.stage.keys import ACTIONS
from msph.stage.page import Page
from msph.stage.row import Row
from msph.stage.sheet import text_height

# Elapsed time between updates of the displayed numbers of simulations [s], slow enough to be read.
UPDATE_INTERVAL = 0.25
# Keys of the lesson, and keys of the player that a lesson disables, as they change the scene.
PAGE_KEYS, DISABLED_KEYS = ("n", "b", "r"), ("Tab", "BackSpace", "i", "k", "o")
# Keys that tilt the pool.
TILT_KEYS = ("Left", "Right", "Up", "Down")


class Guide(InputOverlay):
    """Overlay of a lesson. row: its simulations, None for a board; size (width, height) of the
    window [pixels]; progress: see LessonProgress. waits: the simulations of a task stand still
    until the user moves a slider, tilts or pushes."""

    def __init__(self, course: Course, row: Row | None, size: tuple[int, int]):
        self.size, self.text = size, text_height(size[1])
        self.reasons = Reasons(course.lesson, course.code, size, self.text)
        self.progress = LessonProgress(course, row, self.reasons.pages)
        self.below = band_height(self.text)
        self.band = TaskBar((size[0], self.below), self.text)
        self.overlay = Overlay(*size, {"band": (size[0], self.below), "why": size})
        self.page, self.full_page = (Page(self.overlay, name) for name in ("band", "why"))
        self.read, self.shown = -np.inf, list[str]()
        self.waits = row is not None

    taken = frozenset((*PAGE_KEYS, *DISABLED_KEYS))

    @property
    def runs(self) -> int:
        return self.progress.runs

    @property
    def pauses(self) -> bool:
        return self.progress.pauses or self.waits

    @property
    def is_full_page(self) -> bool:
        return self.progress.page > len(self.progress.lesson.do)

    def handle_key(self, key: str) -> bool:
        progress = self.progress
        if progress.page == 0 and key in LETTERS:
            progress.answer(LETTERS.index(key) + 1)
        elif key in ("n", "b"):
            if progress.go(1 if key == "n" else -1):
                self._begin()
        elif key == "r" and progress.task:
            progress.restart()
            self._begin()
        elif self.waits and ACTIONS.get(key) == "pause":
            self.waits = False
        else:
            self.waits = self.waits and key not in TILT_KEYS
            return key in self.taken or (self.is_full_page and key == "h")
        return True

    def _begin(self) -> None:
        """Begins a page with current numbers and still simulations."""
        self.read, self.waits = -np.inf, self.progress.row is not None

    def is_on_page(self, cursor: np.ndarray) -> bool:
        return self.is_full_page or bool(cursor[1] * self.size[1] < self.below)

    def drag(self, cursor: np.ndarray, down: bool, pressed: bool) -> bool:
        """Moves the slider on which the left button was pressed to the cursor, also in the frame of
        the release; returns True while a slider is held."""
        moved = self.page.act(cursor, down, pressed)
        if moved and moved[1] is not None:
            sliders = {s.name: s for s in self.progress.lesson.slider}
            self.progress.move(sliders[moved[0]], moved[1])
        pushes = pressed and not self.is_on_page(cursor)
        self.waits = self.waits and not (moved or pushes)
        return self.page.held is not None

    def update(self) -> None:
        """Updates the task and its displayed numbers after a frame. The tasks of a board are
        checked when a slider is released, not while it moves."""
        if self.progress.row or self.page.held is None:
            self.progress.update()
        now = time.perf_counter()
        if self.progress.row is None or now - self.read > UPDATE_INTERVAL:
            self.read, self.shown = now, self.progress.shown()

    def draw(self, image) -> None:
        p = self.progress
        values = tuple(p.values.values())
        content = (p.page, p.answered, tuple(p.ticked), values, tuple(self.shown), self.waits)
        if self.is_full_page:
            self.page.hide()
            paint = partial(self.reasons.paint, p.page - 1 - len(p.lesson.do), p)
            self.full_page.show(p.page, paint, (0, 0))
        else:
            self.full_page.hide()
            paint = partial(self.band.paint, p, self.shown, self.waits)
            self.page.show(content, paint, (0, self.size[1] - self.below))
        self.overlay.draw(image)
