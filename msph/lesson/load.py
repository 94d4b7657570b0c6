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
from msph.lesson.excerpt import excerpt
from msph.lesson.numbers import known_numbers
from msph.lesson.schema import LINES, REASON, WORDS, Lesson, SliderOf, Task, WaterOf
from msph.lesson.typeset import check_formula
from msph.scene.check import views
from msph.scene.errors import SceneError, explaining, in_file, require, require_known
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
    """Returns the file of a lesson given by shipped name, folder or file. Raises SceneError."""
    lessons, path = shipped_lessons(), Path(name).resolve()
    if name in lessons:
        return lessons[name]
    for candidate in (path / FILE, path):
        if os.path.isfile(candidate):
            return candidate
    hint = f"no such lesson; {did_you_mean(name, lessons, 'shipped')}"
    raise SceneError(name, f"has no {FILE}" if os.path.isdir(path) else hint)


def load_lesson(name: str) -> Course:
    """Returns a checked lesson. Raises SceneError."""
    path = find_lesson(name)
    data = read_toml(path)
    where = f"{path.parent.name}/{path.name}"
    try:
        lesson = Lesson.model_validate(data)
    except ValidationError as error:
        raise explain(error, where, Lesson) from None
    with in_file(where):
        one = bool(lesson.board) != bool(lesson.water)
        require(one, "", "needs either [[water]] tables or a board")
        scenes = [_scene(water, path.parent, k) for k, water in enumerate(lesson.water)]
        known = _known(lesson, scenes)
        _check_sliders(lesson, scenes)
        _check_words(lesson)
        for k, task in enumerate(lesson.do):
            _check_task(lesson, task, known, f"do.{k}")
            if task.view:
                require_known(task.view, views(scenes[0]) if scenes else (), "view", f"do.{k}.view")
        return Course(path.parent.name, lesson, scenes, _code(lesson))


def _scene(water: WaterOf, folder: Path, k: int) -> Scene:
    """Returns the scene of a simulation with its changes applied."""
    name = water.scene if water.scene in shipped_scenes() else str(folder / water.scene)
    changes = [f"{key}={_toml(value)}" for key, value in water.set.items()]
    with explaining(f"water.{k}"):
        return load_scene(name, tuple(changes))


def _toml(value: Any) -> str:
    """Returns a value in the syntax of overrides."""
    if isinstance(value, str):
        return value
    # Within another list, tables are written inline.
    listed = tomli_w.dumps({"value": [value]}).partition("=")[2]
    return listed.strip()[1:-1].strip().rstrip(",")


def _known(lesson: Lesson, scenes: list[Scene]) -> dict[str, set[str] | None]:
    """Returns the names that expressions may use, with their attributes, or None for numbers."""
    known: dict[str, set[str] | None] = {s.name: None for s in lesson.slider}
    require(len(known) == len(lesson.slider), "slider", "two sliders have the same name")
    for water, scene in zip(lesson.water, scenes, strict=True):
        require(water.name not in known, "", f"the name {water.name!r} is used twice")
        known[water.name] = known_numbers(scene)
    if lesson.board:
        require_known(lesson.board, MODULES, "board", "board")
        known["board"] = set(board_of(lesson.board).NUMBERS)
    return known


def _check_sliders(lesson: Lesson, scenes: list[Scene]) -> None:
    for k, slider in enumerate(lesson.slider):
        key = f"slider.{k}"
        ordered = slider.lo <= slider.start <= slider.hi and slider.lo < slider.hi
        require(ordered, key, "start must lie between lo and hi, and lo below hi")
        problem = f"divides the range into more than {MAX_STEPS} steps (got {slider.step:g})"
        few = not slider.step or slider.hi - slider.lo <= MAX_STEPS * slider.step
        require(few, f"{key}.step", problem)
        require(not keyword.iskeyword(slider.name), f"{key}.name", "is a reserved word")
        if lesson.board:
            _check_input(lesson, slider, key)
            continue
        live = {live.key for scene in scenes for live in live_parameters(scene)} - WINDOW_ONLY
        require_known(slider.key, sorted(live), "live parameter", f"{key}.key")
        for end in ("lo", "hi"):
            _check_end(scenes, slider, end, f"{key}.{end}")


def _check_input(lesson: Lesson, slider: SliderOf, key: str) -> None:
    inputs = board_of(lesson.board).INPUTS
    require_known(slider.name, inputs, "input", f"{key}.name")
    problem = "is not allowed with a board, whose inputs are selected by the slider's name"
    require(not slider.key, f"{key}.key", problem)
    given = inputs[slider.name]
    whole = slider.step == 1.0 and not slider.lo % 1.0 and not slider.start % 1.0
    problem = f"must step by 1 through the named values of {slider.name}"
    require(whole or not given.names, key, problem)
    problem = f"the board's range of {slider.name} is {given.lo:g} to {given.hi:g}"
    require(given.lo <= slider.lo and slider.hi <= given.hi, key, problem)


def _check_end(scenes: list[Scene], slider: SliderOf, end: str, key: str) -> None:
    """Raises SceneError if an end of a slider is outside its parameter's range."""
    for scene in scenes:
        try:
            moved = with_live_value(scene, slider.key, getattr(slider, end))
            Scene.model_validate(moved.model_dump(exclude_none=True))
        except ValidationError as error:
            problem = error.errors()[0]["msg"]
            raise SceneError("", problem[0].lower() + problem[1:], key) from None


def _check_task(lesson: Lesson, task: Task, known: dict, key: str) -> None:
    for name, text in (("check", task.check), *(("show", text) for _, _, text in task.lines)):
        with explaining(f"{key}.{name}"):
            expressions.check(text, known)
    sliders = {slider.name: slider for slider in lesson.slider}
    for name, value in task.solution.set.items():
        require_known(name, sliders, "slider", f"{key}.solution.set")
        inside = sliders[name].lo <= value <= sliders[name].hi
        problem = f"{name} = {value:g} is outside the slider's range"
        require(inside, f"{key}.solution.set", problem)
    moves = task.solution.set or not lesson.board
    require(moves, f"{key}.solution", "must move a slider, as the lesson has a board")


def _check_words(lesson: Lesson) -> None:
    """Raises SceneError for long captions, characters beyond ASCII, which some fonts lack, control
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
    for texts, limit in ((long, WORDS), (reasons, REASON), (short, SHORT_WORDS)):
        for key, text in texts.items():
            words = len(text.split())
            require(words <= limit, key, f"has {words} words; at most {limit}")
            require(text.isascii(), key, "has characters beyond ASCII")
            printable = text.replace("\n", " ").isprintable()
            require(printable, key, f"has control characters (got {shortened(text)})")
    most = len(lesson.predict.choices)
    chosen = lesson.predict.answer <= most
    require(chosen, "predict.answer", f"must be a choice from 1 to {most}")
    problem = f"needs {most} reasons, one for each choice"
    require(len(lesson.predict.because) == most, "predict.because", problem)
    with explaining("why.formula"):
        check_formula(lesson.why.formula)


def _code(lesson: Lesson) -> list[str]:
    with explaining("why.code"):
        code = excerpt(lesson.why.code, lesson.why.first, lesson.why.last)
    problem = f"has {len(code)} lines, at most {LINES}; `first` and `last` select some"
    require(len(code) <= LINES, "why.code", problem)
    return code
