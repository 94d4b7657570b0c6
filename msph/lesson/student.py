"""Simulated student: carries out the solutions of a lesson headless, for tests and pages."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from msph.errors import BlowUpError
from msph.fluid.external_forces import Hand
from msph.lesson.course import LessonProgress
from msph.lesson.schema import Solution
from msph.stage.controls import Controls
from msph.stage.preparation import say
from msph.stage.row import Row

# Frame time [s]; shares of a solution's time for moving sliders, pool and camera, and for pushing;
# radius of the push over the box's longest edge, and its grip [1/s].
FRAME = 1.0 / 60.0
MOVING, PUSHING, PUSH_RADIUS, GRIP = 0.25, 0.3, 0.3, 20.0

# Called after each frame.
See = Callable[[], None]


class Student:
    """Simulated student. row: the lesson's simulations, None for a board; see: called after each
    frame; lingers: time [s] that a completed task continues."""

    def __init__(
        self,
        progress: LessonProgress,
        row: Row | None,
        see: See = lambda: None,
        lingers: float = 0.2,
    ):
        self.progress, self.row, self.see, self.lingers = progress, row, see, lingers

    def answer(self) -> None:
        """Gives the correct answer, and turns to the first task."""
        self.progress.answer(self.progress.lesson.predict.answer)
        self.progress.go(1)

    def work(self) -> bool:
        """Carries out the solution of the page's task; returns True if the task was completed."""
        progress, task = self.progress, self.progress.task
        assert task is not None
        solution = task.solution
        begin = dict(progress.values)
        camera = self._view()
        number = max(2, round(solution.seconds / FRAME))
        left = number
        for k in range(number):
            if left == 0:
                break
            left -= 1
            # A board is checked at the final values of its sliders only.
            share = min(1.0, (k + 1) / (MOVING * number)) if self.row else 1.0
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
                # Some tasks end in an unstable simulation, but only after their check holds.
                if not ticked:
                    raise
                progress.again()
                break
            if progress.ticked[progress.page - 1] and not ticked:
                left = round(self.lingers / FRAME)
        return progress.ticked[progress.page - 1]

    def _view(self) -> tuple[float, ...]:
        """Returns azimuth and elevation of the camera [rad], empty without an image."""
        if self.row is None or self.row.lead.display.picture is None:
            return ()
        return self.row.lead.display.camera.azimuth, self.row.lead.display.camera.elevation

    def _orbit(self, solution: Solution, camera: Any, share: float) -> None:
        """Moves the camera by a share of the solution's orbit from where it was."""
        assert self.row is not None
        lead = self.row.lead
        lead.display.camera.azimuth, lead.display.camera.elevation = camera
        lead.display.camera.orbit(*(share * math.radians(a) for a in solution.orbit))

    def _frame(self, solution: Solution, share: float, pushes: bool) -> None:
        """Runs one frame with the solution's tilt and push."""
        if self.row is not None:
            roll, pitch = (share * math.radians(a) for a in solution.tilt)
            hand = self._hand(solution) if pushes and any(solution.push) else Hand()
            azimuth = self._view()[0] if self._view() else 0.0
            self.row.frame(Controls(FRAME, tilt=(roll, pitch), azimuth=azimuth, hand=hand))
        # Sliders, pool and camera first reach the values that the text names.
        if share == 1.0:
            self.progress.update()
        self.see()

    def _hand(self, solution: Solution) -> Hand:
        assert self.row is not None
        sim = self.row.lead.simulation
        middle = sim.particles.numpy("x").mean(axis=0)
        x, y, z = np.asarray(middle, float).tolist()
        return Hand((x, y, z), solution.push, (PUSH_RADIUS * max(sim.size),) * 3, GRIP)


def rehearse(student: Student) -> None:
    """Solves the page's task, and warns if its check holds before the solution or not after."""
    progress = student.progress
    task = f"{progress.course.name}: do.{progress.page - 1}"
    if progress.holds():
        say(f"warning: {task}.check: holds before the solution")
    if not student.work():
        say(f"warning: {task}.solution: does not make the check hold")
