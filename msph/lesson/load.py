"""Reading and checking lessons."""

import keyword
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tomli_w
from pydantic import ValidationError

from msph import expressions
from msph.errors import did_you_mean
from msph.lesson.boards import MODULES, board_of
from msph.lesson.excerpt import ExcerptError, excerpt
from msph.lesson.quantities import known_numbers
from msph.lesson.schema import LINES, REASON, WORDS, Lesson, SliderOf, Task, WaterOf
from msph.lesson.typeset import FormulaError, check_formula
from msph.scene.check import views
from msph.scene.errors import SceneError
from msph.scene.library import assets, shipped_scenes
from msph.scene.live import live_parameters, with_live_value
from msph.scene.load import explain, load_scene, read_toml, shortened
from msph.scene.schema import Scene

FILE = "lesson.toml"
# Largest number of words of titles, choices and labels, which have one or two lines.
SHORT_WORDS = 12
# Largest number of steps of a slider, more than the pixels of a screen.
MAX_STEPS = 10_000
# Live parameters that have no effect in a lesson, which has its own time steps and image size.
WINDOW_ONLY = {"play.speed", "play.scale"}


class LessonError(SceneError):
    """A lesson that cannot be used; str() is one line: file, key, problem."""


@dataclass(frozen=True)
class Course:
    """A checked lesson with its scenes and the lines of its code excerpt; name: of its folder."""

    name: str
    lesson: Lesson
    scenes: list[Scene]
    code: list[str]

    @property
    def labels(self) -> list[str]:
        """Labels of the simulations."""
        return [water.label for water in self.lesson.water]

    @property
    def titles(self) -> dict[str, str]:
        """Displayed names of the simulations by their names in expressions: the labels up to a
        colon."""
        return {w.name: w.label.partition(":")[0] or w.name for w in self.lesson.water}


def shipped_lessons() -> dict[str, Path]:
    """Returns the files of the shipped lessons by name, in their order."""
    found = {p.parent.name: p for p in (assets() / "lessons").glob(f"*/{FILE}")}
    return dict(sorted(found.items(), key=lambda item: (read_toml(item[1]).get("order", 99), item)))


def find_lesson(name: str) -> Path:
    """Returns the file of a lesson given by shipped name, folder or file. Raises LessonError."""
    lessons, path = shipped_lessons(), Path(name).resolve()
    if name in lessons:
        return lessons[name]
    for candidate in (path / FILE, path):
        if os.path.isfile(candidate):
            return candidate
    if os.path.isdir(path):
        raise LessonError(name, f"has no {FILE}")
    hint = did_you_mean(name, lessons, "shipped")
    raise LessonError(name, f"no such lesson; {hint}")


def load_lesson(name: str) -> Course:
    """Returns a checked lesson. Raises LessonError, or SceneError for an invalid file."""
    path = find_lesson(name)
    data = read_toml(path)
    where = f"{path.parent.name}/{path.name}"
    try:
        lesson = Lesson.model_validate(data)
    except ValidationError as error:
        raise explain(error, where, Lesson) from None
    if bool(lesson.board) == bool(lesson.water):
        raise LessonError(where, "needs either [[water]] tables or a board")
    scenes = [_scene(water, path.parent, where, k) for k, water in enumerate(lesson.water)]
    known = _known(lesson, scenes, where)
    _check_sliders(lesson, scenes, where)
    _check_words(lesson, where)
    for k, task in enumerate(lesson.do):
        key = f"do.{k}"
        for name, text in (("check", task.check), *(("show", text) for _, _, text in task.lines)):
            try:
                expressions.check(text, known)
            except expressions.ExpressionError as error:
                raise LessonError(where, str(error), f"{key}.{name}") from None
        _check_solution(lesson, task, where, f"{key}.solution")
        if task.view:
            _demand(task.view, views(scenes[0]) if scenes else (), "view", where, f"{key}.view")
    return Course(path.parent.name, lesson, scenes, _code(lesson, where))


def _scene(water: WaterOf, folder: Path, where: str, k: int) -> Scene:
    """Returns the scene of a simulation with its changes applied."""
    beside = folder / water.scene
    name = water.scene if water.scene in shipped_scenes() else str(beside)
    changes = [f"{key}={_toml(value)}" for key, value in water.set.items()]
    try:
        return load_scene(name, tuple(changes))
    except SceneError as error:
        raise LessonError(where, str(error), f"water.{k}") from None


def _toml(value: Any) -> str:
    """Returns a value in the syntax of overrides."""
    if isinstance(value, str):
        return value
    # Within another list, tables are written inline.
    listed = tomli_w.dumps({"value": [value]}).partition("=")[2]
    return listed.strip()[1:-1].strip().rstrip(",")


def _known(lesson: Lesson, scenes: list[Scene], where: str) -> dict[str, set[str] | None]:
    """Returns the names that expressions may use, with their attributes, or None for numbers."""
    known: dict[str, set[str] | None] = {s.name: None for s in lesson.slider}
    if len(known) < len(lesson.slider):
        raise LessonError(where, "two sliders have the same name", "slider")
    for water, scene in zip(lesson.water, scenes, strict=True):
        if water.name in known:
            raise LessonError(where, f"the name {water.name!r} is used twice")
        known[water.name] = known_numbers(scene)
    if lesson.board:
        _demand(lesson.board, MODULES, "board", where, "board")
        known["board"] = set(board_of(lesson.board).NUMBERS)
    return known


def _check_sliders(lesson: Lesson, scenes: list[Scene], where: str) -> None:
    for k, slider in enumerate(lesson.slider):
        key = f"slider.{k}"
        if not slider.lo <= slider.start <= slider.hi or slider.lo == slider.hi:
            raise LessonError(where, "start must lie between lo and hi, and lo below hi", key)
        if slider.step and slider.hi - slider.lo > MAX_STEPS * slider.step:
            problem = f"divides the range into more than {MAX_STEPS} steps (got {slider.step:g})"
            raise LessonError(where, problem, f"{key}.step")
        if keyword.iskeyword(slider.name):
            raise LessonError(where, "is a reserved word", f"{key}.name")
        if lesson.board:
            _check_input(lesson, slider, where, key)
            continue
        live = {live.key for scene in scenes for live in live_parameters(scene)} - WINDOW_ONLY
        _demand(slider.key, sorted(live), "live parameter", where, f"{key}.key")
        for end in ("lo", "hi"):
            _check_end(scenes, slider, end, where, f"{key}.{end}")


def _check_input(lesson: Lesson, slider: SliderOf, where: str, key: str) -> None:
    inputs = board_of(lesson.board).INPUTS
    _demand(slider.name, inputs, "input", where, f"{key}.name")
    if slider.key:
        problem = "is not allowed with a board, whose inputs are selected by the slider's name"
        raise LessonError(where, problem, f"{key}.key")
    given = inputs[slider.name]
    if given.names and (slider.step != 1.0 or slider.lo % 1.0 or slider.start % 1.0):
        problem = f"must step by 1 through the named values of {slider.name}"
        raise LessonError(where, problem, key)
    if slider.lo < given.lo or slider.hi > given.hi:
        problem = f"the board's range of {slider.name} is {given.lo:g} to {given.hi:g}"
        raise LessonError(where, problem, key)


def _check_solution(lesson: Lesson, task: Task, where: str, key: str) -> None:
    sliders = {slider.name: slider for slider in lesson.slider}
    for name, value in task.solution.set.items():
        _demand(name, sliders, "slider", where, f"{key}.set")
        if not sliders[name].lo <= value <= sliders[name].hi:
            problem = f"{name} = {value:g} is outside the slider's range"
            raise LessonError(where, problem, f"{key}.set")
    if lesson.board and not task.solution.set:
        raise LessonError(where, "must move a slider, as the lesson has a board", key)


def _check_end(scenes: list[Scene], slider: SliderOf, end: str, where: str, key: str) -> None:
    """Raises LessonError if an end of a slider is outside its parameter's range."""
    for scene in scenes:
        try:
            moved = with_live_value(scene, slider.key, getattr(slider, end))
            Scene.model_validate(moved.model_dump(exclude_none=True))
        except ValidationError as error:
            problem = error.errors()[0]["msg"]
            raise LessonError(where, problem[0].lower() + problem[1:], key) from None


def _check_words(lesson: Lesson, where: str) -> None:
    """Raises LessonError for long captions, characters beyond ASCII, which some fonts lack, control
    characters, a wrong answer number, and formulas that cannot be typeset."""
    long = {"predict.ask": lesson.predict.ask, "why.text": lesson.why.text}
    long |= {f"do.{k}.text": task.text for k, task in enumerate(lesson.do)}
    long |= {f"do.{k}.watch": task.watch for k, task in enumerate(lesson.do)}
    short = {"title": lesson.title}
    short |= {f"predict.choices.{k}": text for k, text in enumerate(lesson.predict.choices)}
    short |= {f"water.{k}.label": water.label for k, water in enumerate(lesson.water)}
    for k, task in enumerate(lesson.do):
        short |= {f"do.{k}.show.{n}": label for n, (label, _, _) in enumerate(task.lines)}
    reasons = {f"predict.because.{k}": text for k, text in enumerate(lesson.predict.because)}
    for texts, most in ((long, WORDS), (reasons, REASON), (short, SHORT_WORDS)):
        for key, text in texts.items():
            if len(text.split()) > most:
                raise LessonError(where, f"has {len(text.split())} words; at most {most}", key)
            if not text.isascii():
                raise LessonError(where, "has characters beyond ASCII", key)
            if not text.replace("\n", " ").isprintable():
                raise LessonError(where, f"has control characters (got {shortened(text)})", key)
    if lesson.predict.answer > len(lesson.predict.choices):
        most = len(lesson.predict.choices)
        raise LessonError(where, f"must be a choice from 1 to {most}", "predict.answer")
    if len(lesson.predict.because) != len(lesson.predict.choices):
        most = len(lesson.predict.choices)
        raise LessonError(where, f"needs {most} reasons, one for each choice", "predict.because")
    try:
        check_formula(lesson.why.formula)
    except FormulaError as error:
        raise LessonError(where, str(error), "why.formula") from None


def _code(lesson: Lesson, where: str) -> list[str]:
    try:
        code = excerpt(lesson.why.code, lesson.why.first, lesson.why.last)
    except ExcerptError as error:
        raise LessonError(where, str(error), "why.code") from None
    if len(code) > LINES:
        problem = f"has {len(code)} lines, at most {LINES}; `first` and `last` select some"
        raise LessonError(where, problem, "why.code")
    return code


def _demand(name: str, known: Any, what: str, where: str, key: str) -> None:
    """Raises LessonError for an unknown name."""
    if name not in known:
        raise LessonError(where, f"unknown {what} {name!r}; {did_you_mean(name, known)}", key)
