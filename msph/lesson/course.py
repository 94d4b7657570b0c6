"""Progress of a running lesson: page, answer, slider values and completed tasks."""

import math
from types import SimpleNamespace
from typing import Any

from msph import expressions
from msph.lesson.boards import Input, board_of
from msph.lesson.load import Course
from msph.lesson.numbers import Numbers
from msph.lesson.quantities import QUANTITIES
from msph.lesson.schema import SliderOf, Task
from msph.scene.parameters import parameters
from msph.scene.schema import Scene
from msph.stage.row import Row


class LessonProgress:
    """Progress of a lesson. row: its simulations, None for a board. Pages: the question, each task,
    and `code_pages` of the explanation; page: the current one, from 0.

    answered: chosen answer, from 1, 0 if none. ticked: True for each completed task. reached: the
    numbers of each task at its completion, empty if it was completed before this run. values:
    slider values by name.
    """

    def __init__(self, course: Course, row: Row | None, code_pages: int = 1):
        self.course, self.lesson, self.row = course, course.lesson, row
        self.board: Any = board_of(self.lesson.board) if self.lesson.board else None
        self.pages = 1 + len(self.lesson.do) + code_pages
        self.page, self.answered = 0, 0
        self.ticked = [False] * len(self.lesson.do)
        self.reached: list[list[str]] = [[] for _ in self.lesson.do]
        self.inputs: dict[str, Input] = self.board.INPUTS if self.board else {}
        known = {p.key: p.unit for p in parameters(Scene)}
        self.units = {s.name: known.get(s.key, "-") for s in self.lesson.slider}
        self.units |= {name: given.unit for name, given in self.inputs.items()}
        self.values = {name: given.start for name, given in self.inputs.items()}
        self.values |= {s.name: s.start for s in self.lesson.slider}
        self.numbers: dict[str, Numbers] = {}
        self.runs = 0  # number of restarts
        self.again()

    def resume(self, answered: int, ticked: list[bool]) -> None:
        """Restores stored progress at the first open task, with the sliders as set by the solutions
        of the tasks before."""
        self.answered = answered
        sliders = {slider.name: slider for slider in self.lesson.slider}
        for k, task in enumerate(self.lesson.do):
            self.go(1)
            if not ticked[k]:
                return
            self.ticked[k] = True
            for name, value in task.solution.set.items():
                self.move(sliders[name], value)

    @property
    def task(self) -> Task | None:
        """The task of this page, None on other pages."""
        k = self.page - 1
        return self.lesson.do[k] if 0 <= k < len(self.lesson.do) else None

    @property
    def pauses(self) -> bool:
        """True while the simulations are paused, on pages without a task."""
        return self.task is None

    def answer(self, choice: int) -> None:
        """Stores an answer, from 1; later answers are ignored."""
        if self.page == 0 and not self.answered and choice <= len(self.lesson.predict.choices):
            self.answered = choice

    def go(self, step: int) -> bool:
        """Turns pages and returns True if possible; the question must be answered first."""
        page = self.page + step
        if not 0 <= page < self.pages or (step > 0 and not self.answered):
            return False
        self.page = page
        if self.task and self.task.fresh:
            self.again()
        if self.task and self.task.view and self.row and self.row.lead.display.views:
            self.row.lead.display.views.name = self.task.view
        return True

    def again(self) -> None:
        """Resets the simulations and the sliders."""
        self.runs += 1
        if self.row:
            self.row.reset()
            names = [water.name for water in self.lesson.water]
            self.numbers = {n: Numbers(s) for n, s in zip(names, self.row.shows, strict=True)}
        for slider in self.lesson.slider:
            self.move(slider, slider.start)

    def restart(self) -> None:
        """Restarts the task of this page, completed or not."""
        if self.task:
            self.ticked[self.page - 1] = False
            self.again()

    def move(self, slider: SliderOf, value: float) -> None:
        """Sets a slider to the nearest allowed value."""
        value = min(max(value, slider.lo), slider.hi)
        if slider.step:
            steps = round((value - slider.lo) / slider.step)
            value = min(slider.lo + steps * slider.step, slider.hi)
        self.values[slider.name] = value
        if self.row:
            self.row.set(slider.key, value)

    def update(self) -> None:
        """Completes the task of this page if its check holds."""
        k = self.page - 1
        if self.task and not self.ticked[k] and self.holds():
            self.reached[k] = self.shown()
            self.ticked[k] = True

    def names(self) -> dict[str, Any]:
        """Returns the current values of the names in expressions."""
        board = {"board": SimpleNamespace(**self.board.numbers(self.values))} if self.board else {}
        return {**self.values, **self.numbers, **board}

    def shown(self) -> list[str]:
        """Returns a line for each number of this page's task, name, value and unit: the current
        numbers, or those that completed the task."""
        if self.task is None:
            return []
        if self.ticked[self.page - 1]:
            return self.reached[self.page - 1]
        names = self.names()
        return [
            f"{label} = {with_unit(value, unit)}" if label else self._line(text, value)
            for label, unit, text in self.task.lines
            for value in [expressions.value(text, names)]
        ]

    def reading(self, slider: str, value: float) -> str:
        """Returns the value of a slider as text: the value's name, or number and unit."""
        given = self.inputs.get(slider)
        return (given and given.name(value)) or with_unit(value, self.units[slider])

    def holds(self) -> bool:
        """Returns True if the check of this page's task holds; unknown numbers never satisfy it."""
        return self.task is not None and expressions.value(self.task.check, self.names()) is True

    def _line(self, text: str, value: float) -> str:
        """Returns the name of an expression and its value, with a unit if it is a quantity."""
        if text in self.values:
            return f"{text.replace('_', ' ')} {self.reading(text, value)}"
        owner, _, name = text.partition(".")
        unit = "-"
        if name in QUANTITIES and owner in self.numbers:
            unit = QUANTITIES[name].unit
        elif self.board and owner == "board":
            unit = self.board.NUMBERS.get(name, "-")
        label = name.replace("_", " ") if name.isidentifier() else text
        if name.isidentifier() and owner != "board" and len(self.numbers) > 1:
            label = f"{self.course.titles[owner]}: {label}"
        return f"{label} {with_unit(value, unit)}"


def with_unit(value: float, unit: str) -> str:
    """Returns a number with its unit, "-" for none."""
    return readable(value) + (f" {unit}" if unit != "-" else "")


def readable(value: float) -> str:
    """Formats a number without powers of ten."""
    if math.isnan(value):
        return "unknown"
    if abs(value) >= 1000.0:
        return f"{value:,.0f}"
    return f"{value:.4g}" if value == 0.0 or abs(value) >= 1e-3 else "under 0.001"
