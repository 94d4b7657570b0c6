"""Tests of lessons: solutions complete the tasks and inaction does not, errors in lesson files give
one line, and pages and slides are complete."""

import json
import math
import re
import shutil
import xml.etree.ElementTree as ET
from types import SimpleNamespace

import imageio.v2 as imageio
import numpy as np
import pytest
from codespell_lib import main as codespell

from msph.errors import BlowUpError
from msph.expressions import FUNCTIONS, ExpressionError, check, value
from msph.lesson import slides, web
from msph.lesson.board_contours import NUMBERS, contour, open_edges, pair_mesh
from msph.lesson.board_kernels import sampled
from msph.lesson.boards import MODULES, board_of
from msph.lesson.course import Progress, readable
from msph.lesson.excerpt import ExcerptError, excerpt
from msph.lesson.guide import Guide
from msph.lesson.load import load_lesson, shipped_lessons
from msph.lesson.paint import PAD, Band, band_height, folded
from msph.lesson.quantities import QUANTITIES, Numbers
from msph.lesson.schema import LINES, WORDS, SliderOf
from msph.lesson.student import Student
from msph.picture.pixels import Image
from msph.scene.errors import SceneError
from msph.scene.library import assets
from msph.stage.pages import text_height
from msph.stage.preparation import prepare_row

SIZE = (480, 270)
LESSONS = tuple(shipped_lessons())
# Lessons whose quantities are measured in the rendered image.
SEEN = ("light",)


def prepared(course, size=None):
    """Returns the simulations of a lesson, or None for a lesson with a board."""
    if course.lesson.board:
        return None
    return prepare_row(course.scenes, ["" for _ in course.scenes], size)


def test_there_are_ten_lessons_in_order():
    assert len(LESSONS) == 10
    orders = [load_lesson(name).lesson.order for name in LESSONS]
    assert orders == list(range(1, 11))


@pytest.mark.parametrize("name", LESSONS)
def test_solutions_complete_all_tasks_and_inaction_none(name):
    course = load_lesson(name)
    row = prepared(course, (320, 180) if name in SEEN else None)
    progress = Progress(course, row)
    student = Student(progress, row)
    assert not progress.go(1), "the question comes first"
    student.answer()
    for k, task in enumerate(course.lesson.do):
        idle = Student(progress, row).work(acts=False)
        assert not idle, f"task {k + 1} ticks by itself: {progress.shown()}"
        if task.fresh:
            progress.again()
        assert student.work(), f"task {k + 1} does not tick: {progress.shown()}"
        told = " ".join(progress.reached[k])
        assert "unknown" not in told and re.search(r"\d", told)
        assert progress.go(1)
    assert progress.pauses and progress.page == 1 + len(course.lesson.do)


def test_displayed_numbers_equal_the_ledger():
    course = load_lesson("forces")
    row = prepared(course)
    progress = Progress(course, row)
    student = Student(progress, row)
    student.answer()
    student.work()
    show = row.lead
    entry = show.ledger.entries[-1]
    names = progress.names()
    assert names["water"].kinetic_energy == entry.kinetic
    assert names["water"].time == show.simulation.time == pytest.approx(entry.time)
    assert names["gravity"] == course.lesson.do[0].solution.set["gravity"]
    assert math.hypot(*show.scene.gravity) == pytest.approx(names["gravity"])
    # The solver residual is computed again from measured densities, by its formula.
    show.simulation.measure_density()
    density = show.simulation.particles.numpy("density") / show.scene.density
    assert Numbers(show).solver_residual == pytest.approx(
        100.0 * np.maximum(density - 1.0, 0.0).mean(), rel=1e-5
    )
    progress.ticked[0] = False  # an open task shows the current numbers
    shown = dict(line.rsplit(" ", 2)[:2] for line in progress.shown())
    assert float(shown["centre y"]) == pytest.approx(entry.centre[1], rel=1e-3)


def test_captions_are_short_and_spelt_correctly(tmp_path):
    for name in LESSONS:
        lesson = load_lesson(name).lesson
        texts = [lesson.title, lesson.predict.ask, *lesson.predict.choices, lesson.why.text]
        texts += [task.text for task in lesson.do]
        assert all(len(text.split()) <= WORDS for text in texts), name
        (tmp_path / f"{name}.txt").write_text("\n".join(texts))
    assert codespell(str(tmp_path)) == 0


def test_excerpts_equal_the_source():
    for name in LESSONS:
        course = load_lesson(name)
        assert 3 <= len(course.code) <= LINES
        module = course.lesson.why.code.partition(":")[0].replace(".", "/") + ".py"
        source = (assets().parent / module).read_text(encoding="utf-8")
        for line in course.code:
            assert line.strip() in source
    with pytest.raises(ExcerptError, match="no source found for .*Classic.nothing"):
        excerpt("msph.fluid.classic:Classic.nothing")
    with pytest.raises(ExcerptError, match="no line with 'purple'"):
        excerpt("msph.fluid.classic", first="purple")


# A valid lesson; and invalid ones: text to replace in it, replacement, and error message.
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
BAD = {
    "title": ('title = "A small lesson"', "", r"lesson.toml: title: is required"),
    "typo": ("[predict]", "[predikt]", r"predikt: unknown key; did you mean 'predict'\?"),
    "board": ('"contours"', '"contour"', r"board: unknown board 'contour'; did you mean 'contours"),
    "slider": ('name = "threshold"', 'name = "treshold"', r"slider.0.name: unknown input"),
    "range": ("start = 5.0", "start = 9.0", r"slider.0: start must lie between lo and hi"),
    "answer": ("answer = 1", "answer = 3", r"predict.answer: must be a choice from 1 to 2"),
    "number": ("board.ponds ==", "board.pond ==", r"do.0.check: unknown number of 'board' 'pond'"),
    "name": ("board.ponds ==", "water.time ==", r"do.0.check: unknown name 'water'"),
    "assigns": ("board.ponds == 2", "board.ponds = 2", r"do.0.check: .*== compares"),
    "grammar": ("board.ponds == 2", "board.ponds ==", r"do.0.check: is not an expression"),
    "import": ("board.ponds == 2", "__import__('os')", r"do.0.check: unknown function"),
    "words": ("They part.", "word " * 41, r"why.text: has 41 words; at most 40"),
    "formula": ("'f = 5'", r"'\frac{1'", r"why.formula: cannot be typeset"),
    "code": ("board_contours:contour", "board_contours:kontur", r"why.code: no source found for"),
    "long": (
        'code = "msph.lesson.board_contours:contour"\nlast = "segments = []"',
        'code = "msph.lesson.board_contours"',
        r"why.code: has \d+ lines, at most 25",
    ),
    "reasons": (', "The threshold separates them."', "", r"predict.because: .*at least 2 items"),
    "both": ('board = "contours"', "", r"needs either \[\[water\]\] tables or a board"),
    "solution": ("{ threshold = 6.0 }", "{ level = 1.0 }", r"unknown slider 'level'"),
    "far": (
        "{ threshold = 6.0 }",
        "{ threshold = 9.0 }",
        r"do.0.solution.set: threshold = 9 is",
    ),
    "nothing": ("set = { threshold = 6.0 }", "seconds = 1.0", r"do.0.solution: must move a slider"),
    "beyond": ("lo = 1.0", "lo = -1.0", r"slider.0: the board's range of threshold is 0 to 9"),
    "key": ("lo = 1.0", 'lo = 1.0\nkey = "gravity"', r"slider.0.key: is not allowed with a board"),
    "keyword": ('name = "threshold"', 'name = "and"', r"slider.0.name: is a reserved word"),
    "caption": (
        '["one", "two"]',
        '["one", "two \u4e8c"]',
        r"predict.choices.1: has characters",
    ),
    "signs": ("board.ponds == 2", "-" * 900 + "1", r"do.0.check: .*at most 200 .*'-{79}\.\.\.\)"),
    "braces": ("f = 5", "{" * 2000, r"why.formula: .*at most 500 characters"),
    "nested": ("f = 5", "{" * 240 + "}" * 240, r"why.formula: cannot be typeset: too many nested"),
    "path": ('contour"\nlast', "a" + ".a" * 499 + '"\nlast', r"why.code: .*at most 200 char"),
    "step": ("start = 5.0", "start = 5.0\nstep = 1e-300", r"slider.0.step: divides the range into"),
    "control": ("A small", r"A \u001b[31m", r"title: has control characters \(got 'A \\x1b"),
    "foreign": ("msph.lesson.board_contours:contour", "os:getcwd", r"is not part of msph"),
    "constant": ("board_contours:contour", "board_contours:PAIR", r"no source found for .*PAIR"),
}


def written(folder, text):
    folder.mkdir(exist_ok=True)
    (folder / "lesson.toml").write_text(text)
    return str(folder)


@pytest.mark.parametrize("kind", BAD)
def test_an_invalid_lesson_gives_one_line(kind, tmp_path):
    old, new, problem = BAD[kind]
    assert old in TINY
    with pytest.raises(SceneError, match=problem) as error:
        load_lesson(written(tmp_path / "mine", TINY.replace(old, new)))
    assert "\n" not in str(error.value) and str(error.value).startswith("mine/lesson.toml")


def test_a_lesson_of_thirty_lines_works(tmp_path):
    assert len(TINY.strip().splitlines()) < 30
    course = load_lesson(written(tmp_path / "mine", TINY))
    progress = Progress(course, None)
    student = Student(progress, None)
    student.answer()
    assert not student.work(acts=False) and student.work()


def test_sliders_stay_within_the_limits_of_their_parameter(tmp_path):
    shutil.copytree(assets() / "lessons" / "forces", tmp_path / "mine")
    path = tmp_path / "mine" / "lesson.toml"
    path.write_text(path.read_text().replace("lo = 1.0", "lo = -1.0"))
    with pytest.raises(SceneError, match=r"slider.1.lo: input should be greater than 0"):
        load_lesson(str(tmp_path / "mine"))


def test_an_unknown_lesson_gives_a_suggestion():
    with pytest.raises(SceneError, match="no such lesson; did you mean 'kernels'"):
        load_lesson("kernel")


def test_expressions_compare_numbers_and_refuse_other_code():
    names = {"a": 2.0, "b": math.nan}
    assert value("a > 1 and abs(-a) == 2", names) is True
    assert value("b > 1 or b < 1", names) is False
    for text in ("a / 0 > 1", "(a - 3) ** 0.5 > 1", "'text'"):
        assert value(text, names) is not True
    assert "list" not in FUNCTIONS, "simpleeval adds to what it is given"
    for text in (
        "a.__class__",
        "open('x')",
        "[a for a in b]",
        "'x' * 10**9",
        "a.real",
        "'x'",
        "[1]",
    ):
        with pytest.raises(ExpressionError):
            check(text, {"a": None, "b": {"x"}})


def test_a_lesson_resumes_where_it_was_left(tmp_path, monkeypatch):
    """A lesson resumes on its page with its sliders, and a finished lesson starts again but remains
    listed as done.

    Regression: after resuming, the previous page raised an IndexError, and a finished lesson lost
    its completed tasks.
    """
    from msph import user_cache
    from msph.lesson import commands

    monkeypatch.setattr(user_cache, "file", lambda: tmp_path / "kept.json")
    course = load_lesson("kernels")
    progress = Progress(course, None)
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
    assert again.band.paint(again.progress, again.progress.shown()).std() > 1.0
    for _ in range(2):
        again.progress.go(1)
        Student(again.progress, None).work()
    commands.keep(again.progress)
    afresh = Progress(course, None)
    commands.resume(afresh)
    assert afresh.page == 0 and not any(afresh.ticked)
    commands.keep(afresh)
    assert ("kernels", course.lesson.title, "3 of 3 done") in commands.listed()


def test_every_quantity_has_a_unit_and_a_text():
    for quantity in QUANTITIES.values():
        assert quantity.unit and quantity.text


def test_kernels_of_the_board_integrate_to_one():
    r = np.linspace(1e-4, 2.0, 4001)
    for w in sampled(r, 2.0):
        integral = np.trapezoid(4.0 * np.pi * r**2 * w, r)
        assert integral == pytest.approx(1.0, abs=2e-3)


def test_the_grid_is_figure_4_3_of_the_thesis():
    board = board_of("contours")
    start = {name: given.start for name, given in board.INPUTS.items()}
    assert start["threshold"] == 5.0
    rows = ["01322", "24584", "36793", "17693", "14342"]
    assert [[int(n) for n in row] for row in rows] == NUMBERS.tolist()
    # At threshold 5 there is one pond; at 6 two values of 7 are at opposite corners of a cell.
    assert (board.numbers(start)["ponds"], board.numbers(start)["ambiguous"]) == (1.0, 0.0)
    ponds = [
        board.numbers(start | {"threshold": 6.0, "diagonal": diagonal})["ponds"]
        for diagonal in (1.0, 2.0)
    ]
    assert ponds == [2.0, 1.0]


def test_named_values_are_shown_by_name(tmp_path):
    """Named values are displayed by name. Regression: the lesson asked for scene 2, quality 4."""
    progress = Progress(load_lesson("choosing"), None)
    assert progress.reading("scene", 2.0) == "dam break"
    assert progress.reading("quality", 4.0) == "finest"
    assert progress.reading("budget", 2.0) == "2 s/s"
    progress.answer(1), progress.go(1)
    assert progress.shown()[0] == "quality finest"
    with pytest.raises(SceneError, match=r"slider.0: must step by 1 through the named values"):
        load_lesson(
            written(
                tmp_path / "mine",
                TINY.replace("threshold", "rule").replace("8.0", "2.0").replace("5.0", "1.0"),
            )
        )


def test_simulations_have_the_same_name_everywhere():
    """Titles of simulations match their names in checks.

    Regression: System 1 was also called "one".
    """
    several = [course for course in map(load_lesson, LESSONS) if len(course.scenes) > 1]
    for course in several:
        for known, title in course.titles.items():
            assert title.lower().replace(" ", "_") == known


def test_a_completed_task_keeps_its_numbers_until_restarted():
    """A completed task displays the numbers that completed it until it is restarted.

    Regression: another number was displayed next to the current number.
    """
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
    """A task is completed only by the value at which the slider is released.

    Regression: a slider that was dragged past a solution completed the task.
    """
    course = load_lesson("cubes")
    guide = Guide(course, None, SIZE)
    guide.progress.answer(3), guide.progress.go(1)
    guide.progress.move(course.lesson.slider[0], 6.0)
    guide.grip.slider = object()
    guide.update()
    assert not guide.progress.ticked[0]
    guide.grip.slider = None
    guide.update()
    assert guide.progress.ticked[0]


def test_contours_lie_where_the_numbers_cross_the_threshold():
    for threshold in (2.5, 4.5, 6.5):
        for line in contour(threshold, diagonal=False):
            for column, row in line:
                j, i = int(column), int(row)
                a = NUMBERS[i, j]
                b = NUMBERS[min(i + (row > i), 4), min(j + (column > j), 4)]
                t = max(column - j, row - i)
                assert a + t * (b - a) == pytest.approx(threshold)


def test_adjacent_cubes_fit_only_if_decided_by_their_shared_face():
    assert len(open_edges(pair_mesh(by_face=False))) == 4
    assert open_edges(pair_mesh(by_face=True)) == []


def test_boards_fill_their_image():
    for name in MODULES:
        board = board_of(name)
        values = {name: given.start for name, given in board.INPUTS.items()}
        pixels = board.draw(values, (480, 200))
        assert pixels.shape == (200, 480, 3) and pixels.std() > 10.0
        assert set(board.numbers(values)) == set(board.NUMBERS)


def test_a_drawing_reuses_its_layout_and_keeps_no_old_content():
    """Drawing a board again reuses its layout and leaves nothing of the last drawing.

    Regression: each drawing took up to 0.6 s, most of it for the layout.
    """
    for name in MODULES:
        board = board_of(name)
        values = {name: given.start for name, given in board.INPUTS.items()}
        board.draw(values, (480, 200))
        first = board.draw(values, (480, 200))
        drawing, number = board.chart.drawing, len(board.chart.drawing.findobj())
        moved = values | {name: given.lo for name, given in board.INPUTS.items()}
        assert np.any(board.draw(moved, (480, 200)) != first)
        assert np.array_equal(board.draw(values, (480, 200)), first)
        assert board.chart.drawing is drawing and len(drawing.findobj()) == number


@pytest.mark.parametrize("name", LESSONS)
def test_each_answer_is_explained_and_fits_its_page(name, monkeypatch):
    """The reason of each answer is displayed and fits on the page.

    Regression: a wrong answer was only marked as wrong.
    """
    course, size = load_lesson(name), (960, 540)
    text = text_height(size[1])
    low = band_height(text)
    band, drawn = Band((size[0], low), text), []

    def lines(self, texts, x, y, colour, width):
        below = original(self, texts, x, y, colour, width)
        drawn.append((texts, below))
        return below

    original = Band._lines
    monkeypatch.setattr(Band, "_lines", lines)
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
        import taichi as ti

        guide.handle_key("a"), guide.handle_key("n")
        assert guide.handle_key("i") and guide.handle_key("Tab"), (
            "keys for other scenes are consumed"
        )
        image = Image(ti.Vector.field(3, ti.f32, SIZE), *SIZE)
        guide.draw(image)
        place = guide.band.sheet.sliders[0]
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
        import taichi as ti

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


def test_an_unstable_simulation_is_restarted(monkeypatch):
    from msph.lesson import commands

    calls = []

    class Fake:
        size = SIZE

        def __init__(self, *_):
            self.layout = self

        def show_message(self, text):
            calls.append(text)

    def run(row, player, frames):
        if len(calls) < 2:
            raise BlowUpError("boiled")

    class Stub:
        row = type("Row", (), {"reset": lambda self: calls.append("again")})()
        progress = type("Progress", (), {"row": row})()

    monkeypatch.setattr(commands, "Player", Fake)
    monkeypatch.setattr(commands, "run_loop", run)
    monkeypatch.setattr(commands, "Layout", Fake)
    commands.play(Stub(), Fake(), "boiling", None)
    assert calls == ["again", "unstable simulation restarted; r also resets the sliders"]


def test_a_page_is_complete_and_needs_no_network(tmp_path):
    course = load_lesson("cubes")
    (path,) = web.write(course, tmp_path)
    text = path.read_text(encoding="utf-8")
    lesson = course.lesson
    for wanted in (lesson.title, lesson.why.text, *(task.text for task in lesson.do)):
        assert wanted.replace("'", "&#x27;") in text
    links = re.findall(r'(?:src|href)="([^"]*)"', text)
    assert not [link for link in links if not link.startswith(("data:", "#"))]
    formula = re.search(r"<svg.*?</svg>", text, re.DOTALL)
    assert formula and ET.fromstring(formula[0]).tag.endswith("svg")
    assert len(set(re.findall(r'<p id="verdict"', text))) == 1
    assert json.dumps(lesson.predict.because) in text, "a wrong answer is explained"


@pytest.mark.parametrize("name", [name for name in LESSONS if load_lesson(name).lesson.board])
def test_tasks_of_a_page_can_be_completed_with_its_sliders(name, monkeypatch):
    """Each task of a page has the sliders of its solution, and they can complete it.

    Regression: a page asked for a scene but had a slider for the quality only.
    """
    monkeypatch.setattr(web, "SIZE", (480, 200))
    course = load_lesson(name)
    for task, part in zip(course.lesson.do, web.on_board(course), strict=True):
        sliders = re.findall(r'<label>(\w+) .*? max="(\d+)" value="(\d+)"', part)
        frames = json.loads(re.search(r'json">(.*?)</script>', part, re.DOTALL)[1])
        assert {slider for slider, *_ in sliders} == set(task.solution.set)
        assert len(frames) == math.prod(int(last) + 1 for _, last, _ in sliders)
        begin = 0
        for _, last, begins in sliders:
            begin = begin * (int(last) + 1) + int(begins)
        assert not frames[begin]["done"] and any(frame["done"] for frame in frames)


def test_a_page_has_the_start_and_the_solution_of_a_slider_with_many_steps():
    """Regression: of 101 steps a page had 12, perhaps without the start or the solution."""
    slider = SliderOf(name="s", lo=0.0, hi=100.0, step=1.0, start=3.0)
    found = web.positions(slider, True, 3.0, 51.0)
    assert {0.0, 3.0, 51.0, 100.0} <= set(found) and found == sorted(found)


def test_pages_with_videos_ask_for_no_input():
    """Texts next to videos ask for no input. Regression: they told the reader to press keys."""
    asks = re.compile(
        r"\b(press|keys?|drag|sliders?|mouse)\b|(^|[.:,] )(set|tilt|push|raise|lower|turn)\b",
        re.IGNORECASE,
    )
    for course in map(load_lesson, LESSONS):
        for task in () if course.lesson.board else course.lesson.do:
            assert task.watch and not asks.search(task.watch), task.watch


def test_tasks_that_do_not_work_give_a_warning(tmp_path, capsys):
    text = TINY.replace("{ threshold = 6.0 }", "{ threshold = 7.0 }")
    slides.write(load_lesson(written(tmp_path / "vain", text)), tmp_path / "out")
    assert "vain: do.0.solution: does not make the check hold" in capsys.readouterr().err
    text = TINY.replace("board.ponds == 2", "board.ponds > 0")
    web.write(load_lesson(written(tmp_path / "idle", text)), tmp_path / "out")
    assert "idle: do.0.check: holds before the solution" in capsys.readouterr().err


def test_numbers_are_formatted_without_powers_of_ten():
    told = [readable(v) for v in (0.0, 1.234567, 123456.0, 1.3e-6, -2.5e-9, -1890.0, math.nan)]
    assert told == ["0", "1.235", "123,456", "under 0.001", "under 0.001", "-1,890", "unknown"]


def test_videos_of_a_page_play(tmp_path):
    import base64

    frames = [np.full((48, 64, 3), 8 * k, np.uint8) for k in range(10)]
    path = tmp_path / "video.mp4"
    path.write_bytes(base64.b64decode(web.video(frames).partition(",")[2]))
    assert len(list(imageio.get_reader(path).iter_data())) == 10


def test_slides_are_numbered_and_captioned(tmp_path):
    course = load_lesson("kernels")
    *pictures, captions = slides.write(course, tmp_path)
    assert len(pictures) >= 2 + len(course.lesson.do)
    lines = captions.read_text().splitlines()
    assert [line.partition(":")[0] for line in lines] == [p.name for p in pictures]
    for picture in pictures:
        assert imageio.imread(picture).shape[:2] == slides.SIZE[::-1]


def test_teaching_md_lists_every_lesson_and_every_quantity():
    text = (assets().parent / "docs" / "teaching.md").read_text(encoding="utf-8")
    for name, quantity in QUANTITIES.items():
        assert f"| `{name}` | {quantity.unit} | {quantity.text} |" in text
    for name in LESSONS:
        course = load_lesson(name)
        assert f"| `{name}` | {'abcd'[course.lesson.predict.answer - 1]}: " in text


def test_the_lesson_of_teaching_md_works(tmp_path):
    text = (assets().parent / "docs" / "teaching.md").read_text(encoding="utf-8")
    example = re.search(r"```toml\n(.*?)```", text, re.DOTALL)
    assert example and len([line for line in example[1].splitlines() if line]) < 30
    course = load_lesson(written(tmp_path / "mine", example[1]))
    row = prepared(course)
    progress = Progress(course, row)
    student = Student(progress, row)
    student.answer()
    assert not student.work(acts=False), progress.shown()
    assert student.work(), progress.shown()
