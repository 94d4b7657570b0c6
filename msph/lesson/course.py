"""A lesson on its way: which page, what was answered, what is moved, what is ticked."""

import math
from typing import Any

from msph.lesson import expressions
from msph.lesson.boards import board_of
from msph.lesson.load import Course
from msph.lesson.quantities import QUANTITIES, Numbers
from msph.lesson.schema import SliderOf, Task
from msph.stage.row import Row


class Progress:
    """course: the lesson; row: its waters, None where it has a board. Pages: the question, each
    task, the explanation and what of its code did not fit; see `page`.

    answered: what was chosen, from 1, 0 before. ticked: of each task whether it was done. reached:
    of each what its numbers were then. values: of the sliders.
    """

    def __init__(self, course: Course, row: Row | None, code_pages: int = 1):
        self.course, self.lesson, self.row = course, course.lesson, row
        self.board: Any = board_of(self.lesson.board) if self.lesson.board else None
        self.pages = 1 + len(self.lesson.do) + code_pages
        self.page, self.answered = 0, 0
        self.ticked = [False] * len(self.lesson.do)
        self.reached: list[list[str]] = [[] for _ in self.lesson.do]
        inputs = self.board.INPUTS if self.board else {}
        self.values = {name: given.start for name, given in inputs.items()}
        self.values |= {s.name: s.start for s in self.lesson.slider}
        self.numbers: dict[str, Numbers] = {}
        self.runs = 0  # how often the water has begun anew
        self.again()

    def resume(self, answered: int, ticked: list[bool]) -> None:
        """Takes up what was done before at the first task that was not, with the sliders as the
        solutions of those before leave them."""
        self.answered = answered
        sliders = {slider.name: slider for slider in self.lesson.slider}
        for k, task in enumerate(self.lesson.do):
            self.go(1)
            if not ticked[k]:
                return
            self.ticked[k], self.reached[k] = True, ["before"]
            for name, value in task.solution.set.items():
                self.move(sliders[name], value)

    @property
    def task(self) -> Task | None:
        """What there is to do on this page."""
        k = self.page - 1
        return self.lesson.do[k] if 0 <= k < len(self.lesson.do) else None

    @property
    def waits(self) -> bool:
        """Whether nothing runs: the question comes first, and explanations are read in peace."""
        return self.task is None

    def answer(self, choice: int) -> None:
        """Takes an answer, from 1, once."""
        if self.page == 0 and not self.answered and choice <= len(self.lesson.predict.choices):
            self.answered = choice

    def go(self, step: int) -> bool:
        """Turns pages; whether it did. The first is left once it is answered."""
        page = self.page + step
        if not 0 <= page < self.pages or (step > 0 and not self.answered):
            return False
        self.page = page
        if self.task and self.task.fresh:
            self.again()
        if self.task and self.task.view and self.row and self.row.lead.views:
            self.row.lead.views.name = self.task.view
        return True

    def again(self) -> None:
        """Row and sliders as at the start."""
        self.runs += 1
        if self.row:
            self.row.reset()
            names = [water.name for water in self.lesson.water]
            self.numbers = {n: Numbers(s) for n, s in zip(names, self.row.shows, strict=True)}
        for slider in self.lesson.slider:
            self.move(slider, slider.start)

    def refill(self) -> None:
        """Water as at the start, sliders as they are."""
        if self.row:
            self.row.reset()

    def move(self, slider: SliderOf, value: float) -> None:
        """Moves a slider, within its range."""
        value = min(max(value, slider.lo), slider.hi)
        if slider.step:
            steps = round((value - slider.lo) / slider.step)
            value = min(slider.lo + steps * slider.step, slider.hi)
        self.values[slider.name] = value
        if self.row:
            self.row.set(slider.key, value)

    def look(self) -> None:
        """Ticks the task of this page if its check holds now."""
        k = self.page - 1
        if not self.task or self.ticked[k]:
            return
        # Numbers that are not known are no reason to tick.
        if self.holds():
            self.ticked[k] = True
            self.reached[k] = self.shown()

    def names(self) -> dict[str, Any]:
        """What expressions may use, as it is now."""
        board = {"board": self.board.numbers(self.values)} if self.board else {}
        return {**self.values, **self.numbers, **board}

    def shown(self) -> list[str]:
        """The numbers of this page's task, a line each: expression in words, value, unit."""
        if self.task is None:
            return []
        names = self.names()
        return [self._told(text, expressions.value(text, names)) for text in self.task.show]

    def holds(self) -> bool:
        """Whether the check of this page's task holds now."""
        return self.task is not None and expressions.value(self.task.check, self.names()) is True

    def _told(self, text: str, value: float) -> str:
        """A number with its name, and its unit where it is one of a water or of the board."""
        owner, _, name = text.partition(".")
        units = {"board": self.board.NUMBERS} if self.board else {}
        unit = ""
        if name in QUANTITIES and owner in self.numbers:
            unit = QUANTITIES[name].unit
        elif owner in units:
            unit = units[owner].get(name, "")
        label = self._label(owner, name) if name.isidentifier() else text
        return f"{label} {readable(value)}" + (f" {unit}" if unit not in ("", "-") else "")

    def _label(self, owner: str, name: str) -> str:
        words = name.replace("_", " ")
        return words if owner == "board" or len(self.numbers) < 2 else f"{owner}: {words}"


def readable(value: float) -> str:
    """A number as a student reads it, without powers of ten."""
    if math.isnan(value):
        return "unknown"
    if abs(value) >= 1000.0:
        return f"{value:,.0f}"
    return f"{value:.4g}" if value == 0.0 or abs(value) >= 1e-3 else "under 0.001"
