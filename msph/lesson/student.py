"""A student who does what a lesson's solutions say, without a window: for tests and pages."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from msph.errors import BlowUpError
from msph.fluid.external_forces import Hand
from msph.lesson.course import Progress
from msph.lesson.schema import Solution
from msph.stage.controls import Controls
from msph.stage.preparation import say
from msph.stage.row import Row

# Frame [s]; shares of a solution's time in which sliders, pool and view are moved, and in which the
# hand pushes; radius of that hand over the box's longest edge, and its grip [1/s].
FRAME = 1.0 / 60.0
MOVING, PUSHING, HAND, GRIP = 0.25, 0.3, 0.3, 20.0

# Called after each frame.
See = Callable[[], None]


class Student:
    """row: the waters of the lesson, None where it has a board; see: called after each frame;
    lingers: for so long [s] the student goes on with a task that is done."""

    def __init__(
        self,
        progress: Progress,
        row: Row | None,
        see: See = lambda: None,
        lingers: float = 0.2,
    ):
        self.progress, self.row, self.see, self.lingers = progress, row, see, lingers

    def answer(self) -> None:
        """Gives the right answer, and turns to the first task."""
        self.progress.answer(self.progress.lesson.predict.answer)
        self.progress.go(1)

    def work(self, acts: bool = True) -> bool:
        """On the page's task for the time of its solution, doing what it says, or nothing; whether
        the task is ticked then."""
        progress, task = self.progress, self.progress.task
        assert task is not None
        solution = task.solution if acts else Solution(seconds=task.solution.seconds)
        begin = dict(progress.values)
        camera = self._view()
        number = max(2, round(solution.seconds / FRAME))
        left = number
        for k in range(number):
            if left == 0:
                break
            left -= 1
            share = min(1.0, (k + 1) / (MOVING * number))
            for slider in progress.lesson.slider:
                if slider.name in solution.set:
                    a, b = begin[slider.name], solution.set[slider.name]
                    progress.move(slider, a + share * (b - a))
            if camera:
                self._orbit(solution, camera, share)
            ticked = progress.ticked[progress.page - 1]
            try:
                self._frame(solution, share, k < PUSHING * number)
            except BlowUpError:
                # Some tasks ask for it; but first their check must hold.
                if not ticked:
                    raise
                progress.again()
                break
            if progress.ticked[progress.page - 1] and not ticked:
                left = round(self.lingers / FRAME)
        return progress.ticked[progress.page - 1]

    def _view(self) -> tuple[float, ...]:
        """Azimuth and elevation of the view [rad], where there is any."""
        if self.row is None or self.row.lead.picture is None:
            return ()
        return self.row.lead.camera.azimuth, self.row.lead.camera.elevation

    def _orbit(self, solution: Solution, camera: Any, share: float) -> None:
        """The view, a share of the way from where it was."""
        assert self.row is not None
        lead = self.row.lead
        lead.camera.azimuth, lead.camera.elevation = camera
        lead.camera.orbit(*(share * math.radians(a) for a in solution.orbit))

    def _frame(self, solution: Solution, share: float, pushes: bool) -> None:
        """One frame under the solution's hands."""
        if self.row is not None:
            roll, pitch = (share * math.radians(a) for a in solution.tilt)
            hand = self._hand(solution) if pushes and any(solution.push) else Hand()
            self.row.frame(Controls(tilt=(roll, pitch), hand=hand, frame_time=FRAME))
        self.progress.look()
        self.see()

    def _hand(self, solution: Solution) -> Hand:
        assert self.row is not None
        sim = self.row.lead.simulation
        middle = sim.particles.numpy("x").mean(axis=0)
        x, y, z = np.asarray(middle, float).tolist()
        return Hand((x, y, z), solution.push, HAND * max(sim.size), GRIP)


def rehearse(student: Student) -> None:
    """Does the page's task, and warns of a check that holds before, or not even then."""
    progress = student.progress
    task = f"{progress.course.name}: do.{progress.page - 1}"
    if progress.holds():
        say(f"warning: {task}.check: holds before anything is done")
    if not student.work():
        say(f"warning: {task}.solution: does not make the check hold")
