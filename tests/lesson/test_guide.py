"""Tests of the guide through a lesson: its keys, pages and sliders."""

from types import SimpleNamespace

import numpy as np
import pytest
import taichi as ti

from msph.errors import BlowUpError
from msph.lesson import commands
from msph.lesson.course import LessonProgress
from msph.lesson.guide import Guide
from msph.lesson.load import load_lesson
from msph.lesson.paint import PAD, TaskBar, band_height, folded
from msph.lesson.student import Student
from msph.picture.pixels import Image
from msph.stage.controls import Controls
from msph.stage.row import Row
from msph.stage.sheet import Sheet, text_height
from tests.lesson.lesson_kit import LESSONS

SIZE = (480, 270)


def test_a_lesson_resumes_where_it_was_left(cache):
    """A finished lesson starts again but remains listed as done. Regression: after resuming, the
    previous page raised an IndexError, and a finished lesson lost its completed tasks."""
    course = load_lesson("kernels")
    progress = LessonProgress(course, None)
    student = Student(progress, None)
    student.answer()
    student.work()
    commands.keep(progress)
    assert ("kernels", course.lesson.title, "1 of 3 done") in commands.listed()
    again = Guide(course, None, SIZE)
    commands.resume(again.progress)
    assert again.progress.page == 2 and again.progress.answered == 2
    assert again.progress.values["support"] == course.lesson.do[0].solution.set["support"]
    again.handle_key("b")
    assert again.band.paint(again.progress, again.progress.shown()).pixels.std() > 1.0
    for _ in range(2):
        again.progress.go(1)
        Student(again.progress, None).work()
    commands.keep(again.progress)
    afresh = LessonProgress(course, None)
    commands.resume(afresh)
    assert afresh.page == 0 and not any(afresh.ticked)
    commands.keep(afresh)
    assert ("kernels", course.lesson.title, "3 of 3 done") in commands.listed()


def test_a_completed_task_keeps_its_numbers_until_restarted():
    """Regression: another number was displayed next to the current number."""
    course = load_lesson("cubes")
    guide = Guide(course, None, SIZE)
    progress = guide.progress
    progress.answer(3), progress.go(1)
    progress.move(course.lesson.slider[0], 6.0)
    guide.update()
    completed = ["threshold 6", "ponds 2", "ambiguous 1"]
    assert progress.ticked[0] and progress.shown() == completed
    progress.move(course.lesson.slider[0], 8.0)
    assert progress.shown() == completed
    guide.handle_key("r")
    assert not progress.ticked[0] and progress.shown() == ["threshold 5", "ponds 1", "ambiguous 0"]


def test_a_board_is_checked_when_its_slider_is_released():
    """Regression: a slider that was dragged past a solution completed the task."""
    course = load_lesson("cubes")
    guide = Guide(course, None, SIZE)
    guide.progress.answer(3), guide.progress.go(1)
    guide.progress.move(course.lesson.slider[0], 6.0)
    guide.page.held = object()
    guide.update()
    assert not guide.progress.ticked[0]
    guide.page.held = None
    guide.update()
    assert guide.progress.ticked[0]


@pytest.mark.parametrize("name", LESSONS)
def test_each_answer_is_explained_and_fits_its_page(name, monkeypatch):
    """Regression: a wrong answer was only marked as wrong."""
    course, size = load_lesson(name), (960, 540)
    text = text_height(size[1])
    low = band_height(text)
    band, drawn = TaskBar((size[0], low), text), []

    def lines(self, texts, x, y, colour, width):
        below = original(self, texts, x, y, colour, width)
        drawn.append((texts, below))
        return below

    original = Sheet.write_wrapped
    monkeypatch.setattr(Sheet, "write_wrapped", lines)
    keys = low - (PAD + 1.0) * text
    predict = course.lesson.predict
    for k, reason in enumerate(predict.because, 1):
        drawn.clear()
        band.paint(
            SimpleNamespace(lesson=course.lesson, task=None, answered=k, page=0, pages=3), []
        )
        told = [line for texts, _ in drawn for line in texts]
        assert reason in told and any(line.endswith("correct") for line in told)
        assert max(below for _, below in drawn[:-1]) <= keys


class TestGuide:
    """Tests of key and mouse input in a lesson with a board."""

    @pytest.fixture
    def guide(self):
        return Guide(load_lesson("cubes"), None, SIZE)

    def test_the_question_is_answered_before_anything_runs(self, guide):
        assert guide.handle_key("n") and guide.progress.page == 0 and guide.pauses
        assert guide.handle_key("d") and guide.progress.answered == 0, "there are three choices"
        assert guide.handle_key("b") and guide.progress.answered == 2
        assert guide.handle_key("a") and guide.progress.answered == 2, "an answer counts once"
        assert guide.handle_key("n") and guide.progress.page == 1 and not guide.pauses
        assert guide.handle_key("b") and guide.progress.page == 0
        assert not guide.handle_key("p")

    def test_a_slider_follows_the_mouse_until_released(self, guide):
        guide.handle_key("a"), guide.handle_key("n")
        assert guide.handle_key("i") and guide.handle_key("Tab"), (
            "keys for other scenes are consumed"
        )
        image = Image(ti.Vector.field(3, ti.f32, SIZE), *SIZE)
        guide.draw(image)
        place = guide.page.sheet.widgets[0]
        y = 1.0 - (SIZE[1] - guide.below + 0.5 * (place.top + place.bottom)) / SIZE[1]

        def at(x):
            return np.array([x / SIZE[0], y])

        assert guide.is_on_page(at(place.left)) and not guide.is_on_page(np.array([0.5, 0.9]))
        # A button that was pressed elsewhere moves no slider.
        assert not guide.drag(np.array([0.1, 0.9]), True, True)
        assert not guide.drag(at(place.left), True, False)
        guide.drag(at(place.left), False, False)
        assert guide.drag(at(place.left), True, True)
        assert guide.progress.values["threshold"] == place.lo
        assert guide.drag(np.array([2.0, 2.0]), True, False), "a drag may leave the window"
        assert guide.progress.values["threshold"] == place.hi
        # The position of the release counts, also for a whole drag between two frames.
        assert not guide.drag(at(place.left), False, False)
        assert guide.progress.values["threshold"] == place.lo
        assert not guide.drag(np.array([2.0, 2.0]), False, True)
        assert guide.progress.values["threshold"] == place.hi
        assert not guide.drag(at(place.left), False, True)
        assert guide.progress.values["threshold"] == place.lo
        assert guide.handle_key("r") and guide.progress.values["threshold"] == 5.0

    def test_pages_are_drawn_over_the_image(self, guide):
        image = Image(ti.Vector.field(3, ti.f32, SIZE), *SIZE)
        image.field.fill(1.0)
        guide.draw(image)
        pixels = image.field.to_numpy()
        assert pixels[:, : guide.below].mean() < 0.3 and pixels[:, guide.below :].min() == 1.0
        guide.handle_key("a")
        for _ in range(1 + len(guide.progress.lesson.do)):
            guide.handle_key("n")
        assert guide.is_full_page and guide.is_on_page(np.array([0.5, 0.9]))
        guide.draw(image)
        assert image.field.to_numpy().mean() < 0.3

    def test_text_is_large_enough_and_wrapped(self):
        assert text_height(540) >= 18 and band_height(18) < 0.45 * 540
        assert folded("    x = 1", 80) == ["    x = 1"]
        assert folded("    " + "word " * 30, 40)[1].startswith(" " * 12)


def test_an_unstable_simulation_is_restarted():
    """All simulations begin again where one becomes unstable, and one message says so."""

    class Unstable:
        size, simulated, note, resets, later = None, 0.0, "", 0, []

        def frame(self, controls):
            raise BlowUpError("boiled")

        def reset(self):
            self.resets += 1

    shows = [Unstable(), Unstable()]
    Row(shows, restart=commands.RESTARTED).frame(Controls())
    assert [show.resets for show in shows] == [1, 1] and shows[0].note == commands.RESTARTED
    with pytest.raises(BlowUpError):
        Row(shows).frame(Controls())
