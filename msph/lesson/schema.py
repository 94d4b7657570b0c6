"""Every key of a lesson file, declared once: what `msph lesson` reads, and its clear errors."""

from typing import Annotated, Any

from pydantic import Field

from msph.parameter import Number, Section, parameter

# Most words of a caption, choices, waters, sliders and lines of an excerpt: what can be read at a
# glance, told apart, seen side by side, laid out under a picture, and followed.
WORDS, CHOICES, WATERS, SLIDERS, LINES = 40, 4, 3, 4, 40
# Names that expressions know waters and sliders by.
NAME = r"^[a-z][a-z0-9_]*$"


class WaterOf(Section):
    """One of the waters, side by side from left to right."""

    name: str = parameter("water", pattern=NAME, text="by which expressions know it")
    scene: str = parameter(text="a shipped scene, or a file beside the lesson")
    set: dict[str, Any] = parameter(dict, text='changes, such as { "classic.stiffness" = 50.0 }')
    label: str = parameter("", text="shown over it, with its speed and error")


class SliderOf(Section):
    """A slider under the picture: for a live parameter of the scenes, or a number of the board."""

    name: str = parameter(pattern=NAME, text="by which expressions know it; shown beside it")
    key: str = parameter("", text="the live parameter; default: the board's number of that name")
    lo: float = parameter(text="least value, in the parameter's unit")
    hi: float = parameter(text="largest value")
    start: float = parameter(text="value at the start")
    step: float = parameter(0.0, ge=0.0, text="distance of the values it can take, 0: any")


class Predict(Section):
    """The question that is answered before anything runs."""

    ask: str = parameter(text="the question")
    choices: list[str] = parameter(min_length=2, max_length=CHOICES, text="what may be chosen")
    answer: int = parameter(ge=1, text="which is right, from 1")


class Solution(Section):
    """What somebody does who solves a task: for tests, pages and teachers."""

    set: dict[str, Number] = parameter(dict, text="sliders and where they are moved to")
    tilt: Annotated[tuple[Number, Number], Field(strict=False)] = parameter(
        (0.0, 0.0), unit="deg", text="of the pool, rolled and pitched"
    )
    push: Annotated[tuple[Number, Number, Number], Field(strict=False)] = parameter(
        (0.0, 0.0, 0.0), unit="m/s", text="velocity of a hand in the middle of the water"
    )
    orbit: Annotated[tuple[Number, Number], Field(strict=False)] = parameter(
        (0.0, 0.0), unit="deg", text="of the view, round and up"
    )
    seconds: float = parameter(3.0, gt=0.0, le=60.0, unit="s", text="simulated time it lasts")


class Task(Section):
    """Something to do, and the number that tells when it is done."""

    text: str = parameter(text="what to do, at most 40 words")
    check: str = parameter(text="expression that is true once it is done")
    show: list[str] = parameter(min_length=1, max_length=3, text="numbers shown, expressions")
    fresh: bool = parameter(False, text="begin with the water and the sliders as at the start")
    view: str = parameter("", text="what the picture shows, as picture.view of a scene")
    solution: Solution = parameter(text="what solves it")


class Why(Section):
    """The explanation: a caption, a formula, and the code that does it."""

    text: str = parameter(text="at most 40 words")
    formula: str = parameter(text="in TeX's mathematics, without the dollars")
    code: str = parameter(text="module:name or module:Class.name of what does it")
    first: str = parameter("", text="begin the excerpt at the first line that holds this")
    last: str = parameter("", text="end it at the first line after that holds this")


class Lesson(Section):
    """A lesson file, lesson.toml in a folder of its own."""

    title: str = parameter(text="one line")
    order: int = parameter(99, ge=0, text="place in the list")
    water: list[WaterOf] = parameter(list, max_length=WATERS, text="waters, side by side")
    board: str = parameter("", text="a drawing in place of waters: kernels, contours, ladder")
    slider: list[SliderOf] = parameter(list, max_length=SLIDERS, text="what can be moved")
    predict: Predict = parameter(text="before anything runs")
    do: list[Task] = parameter(min_length=1, max_length=4, text="tasks, one after another")
    why: Why = parameter(text="afterwards")
