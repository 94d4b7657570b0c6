"""Tests of lesson files: errors in them give one line."""

import math
import shutil

import pytest

from msph.expressions import ExpressionError, check, value
from msph.lesson.course import LessonProgress
from msph.lesson.load import load_lesson
from msph.scene.errors import SceneError
from msph.scene.library import assets
from tests.lesson.lesson_kit import LESSONS, TINY, written

# Invalid lessons: text to replace in TINY, replacement, and error message.
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


@pytest.mark.parametrize("kind", BAD)
def test_an_invalid_lesson_gives_one_line(kind, tmp_path):
    old, new, problem = BAD[kind]
    assert old in TINY
    with pytest.raises(SceneError, match=problem) as error:
        load_lesson(written(tmp_path / "mine", TINY.replace(old, new)))
    assert "\n" not in str(error.value) and str(error.value).startswith("mine/lesson.toml")


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


def test_numbers_are_shown_with_their_label_and_unit(tmp_path):
    """Regression: students read `54.2 / gravity ** 0.5 * (...)` instead of a name."""
    shown = '"board.ponds", "half, of ponds [m/s]: board.ponds / 2", "twice: 2 * board.ponds"'
    progress = LessonProgress(
        load_lesson(
            written(tmp_path / "mine", TINY.replace('show = ["board.ponds"', f"show = [{shown}"))
        ),
        None,
    )
    progress.answer(1), progress.go(1)
    assert progress.shown() == ["ponds 1", "half, of ponds = 0.5 m/s", "twice = 2"]
    for name in LESSONS:
        for task in load_lesson(name).lesson.do:
            for label, _, text in task.lines:
                assert label or text.replace(".", "").isidentifier(), f"{name}: {text} has no label"


def test_named_values_are_shown_by_name(tmp_path):
    """Regression: the lesson asked for scene 2, quality 4."""
    progress = LessonProgress(load_lesson("choosing"), None)
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
