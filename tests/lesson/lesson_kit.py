"""Lessons that the tests of lessons share."""

from msph.lesson.course import LessonProgress
from msph.lesson.load import load_lesson, shipped_lessons
from msph.lesson.student import FRAME, Student
from msph.stage.controls import Controls
from msph.stage.link import Order
from msph.stage.preparation import prepare_row

LESSONS = tuple(shipped_lessons())
BOARDS = tuple(name for name in LESSONS if load_lesson(name).lesson.board)


def prepared(course, size=None):
    """Returns the simulations of a lesson, or None for a lesson with a board."""
    if course.lesson.board:
        return None
    return prepare_row(Order(course.scenes, ["" for _ in course.scenes]), size)


def answered(course, size=None):
    """Returns the simulations of a lesson, its progress and a student who has answered."""
    row = prepared(course, size)
    progress = LessonProgress(course, row)
    student = Student(progress, row)
    assert not progress.go(1), "the question comes first"
    student.answer()
    return row, progress, student


# Time [s] without input of tasks that need a slider or the camera, which only the user moves.
IDLE = 0.25


def ticks_without_input(progress, row):
    """Runs the page's task without input; returns True if it was completed."""
    task = progress.task
    needs_user = any(task.solution.orbit) or any(k in task.check for k in task.solution.set)
    for _ in range(round((IDLE if needs_user else task.solution.seconds) / FRAME) if row else 1):
        if row:
            row.frame(Controls(FRAME))
        progress.update()
    return progress.ticked[progress.page - 1]


# A valid lesson.
TINY = """
title = "A small lesson"
board = "contours"
[[slider]]
name = "threshold"
lo = 1.0
hi = 8.0
start = 5.0
[predict]
ask = "How many ponds?"
choices = ["one", "two"]
because = ["The contour is one line.", "The threshold separates them."]
answer = 1
[[do]]
text = "Raise the threshold."
check = "board.ponds == 2"
show = ["board.ponds"]
solution = { set = { threshold = 6.0 } }
[why]
text = "They part."
formula = 'f = 5'
code = "msph.lesson.board_contours:contour"
last = "segments = []"
"""


def written(folder, text):
    folder.mkdir(exist_ok=True)
    (folder / "lesson.toml").write_text(text)
    return str(folder)
