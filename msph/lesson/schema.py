"""Schema of a lesson file: every key with default, range, unit and help text."""

from typing import Annotated, Any

from pydantic import Field

from msph.parameter import Number, Section, parameter

# Largest numbers of words of a caption and of the reason for a choice, of choices, simulations and
# sliders: as many as fit into the layout. Largest number of lines of an excerpt to read.
WORDS, REASON, CHOICES, WATERS, SLIDERS, LINES = 40, 25, 4, 3, 4, 25
# Largest length of an expression, a formula and the path of a function. The libraries that read
# them recurse once for each bracket or sign, and Python's limit is 1,000 calls.
EXPRESSION, FORMULA, PATH = 200, 500, 200
# Pattern of the names of simulations and sliders in expressions.
NAME = r"^[a-z][a-z0-9_]*$"


Expression = Annotated[str, Field(max_length=EXPRESSION)]


class WaterOf(Section):
    """A simulation of the lesson; several run side by side, from left to right."""

    name: str = parameter("water", pattern=NAME, text="name in expressions")
    scene: str = parameter(text="a shipped scene, or a scene file in the lesson's folder")
    set: dict[str, Any] = parameter(dict, text='changes, such as { "classic.stiffness" = 50.0 }')
    label: str = parameter("", text="label above the image, with speed and error")


class SliderOf(Section):
    """A slider below the image, for a live parameter of the scenes or an input of the board."""

    name: str = parameter(pattern=NAME, text="name in expressions, and label")
    key: str = parameter("", text="live parameter; default: the board's input of that name")
    lo: float = parameter(text="least value, in the parameter's unit")
    hi: float = parameter(text="largest value")
    start: float = parameter(text="initial value")
    step: float = parameter(0.0, ge=0.0, text="increment of its values, 0: continuous")


class Predict(Section):
    """The question at the start of the lesson."""

    ask: str = parameter(text="the question")
    choices: list[str] = parameter(min_length=2, max_length=CHOICES, text="possible answers")
    because: list[str] = parameter(
        min_length=2, max_length=CHOICES, text="why each choice is right or wrong, in their order"
    )
    answer: int = parameter(ge=1, text="number of the correct answer, from 1")


class Solution(Section):
    """Actions that solve a task, for tests, pages, slides and teachers."""

    set: dict[str, Number] = parameter(dict, text="final slider values by name")
    tilt: Annotated[tuple[Number, Number], Field(strict=False)] = parameter(
        (0.0, 0.0), unit="deg", text="roll and pitch of the pool"
    )
    push: Annotated[tuple[Number, Number, Number], Field(strict=False)] = parameter(
        (0.0, 0.0, 0.0), unit="m/s", text="velocity of a push at the centre of mass"
    )
    orbit: Annotated[tuple[Number, Number], Field(strict=False)] = parameter(
        (0.0, 0.0), unit="deg", text="change of the camera's azimuth and elevation"
    )
    seconds: float = parameter(3.0, gt=0.0, le=60.0, unit="s", text="simulated time of the actions")


class Task(Section):
    """A task, and the condition that completes it."""

    text: str = parameter(text="what to do, at most 40 words")
    watch: str = parameter("", text="what to see in the video of a web page, at most 40 words")
    check: Expression = parameter(text="expression that is true when the task is completed")
    show: list[Expression] = parameter(
        min_length=1, max_length=3, text='what to display: an expression, or "LABEL [UNIT]: ..."'
    )
    fresh: bool = parameter(False, text="reset the simulations and the sliders at the start")
    view: str = parameter("", text="view of the image, as picture.view of a scene")
    solution: Solution = parameter(text="actions that solve the task")

    @property
    def lines(self) -> list[tuple[str, str, str]]:
        """Label ("" for none), unit ("-" for none) and expression of each number to display."""
        parts = [text.rpartition(":") for text in self.show]
        heads = [head.removesuffix("]").partition(" [") for head, _, _ in parts]
        return [(h[0], h[2] or "-", part[2].strip()) for h, part in zip(heads, parts, strict=True)]


class Why(Section):
    """The explanation: a caption, a formula, and the code that implements it."""

    text: str = parameter(text="caption, at most 40 words")
    formula: str = parameter(
        max_length=FORMULA, text="formula in TeX math mode, without the dollars"
    )
    code: str = parameter(max_length=PATH, text="code to show: module:name or module:Class.name")
    first: str = parameter("", text="text in the first line of the excerpt")
    last: str = parameter("", text="text in the last line of the excerpt")


class Lesson(Section):
    """A lesson file, lesson.toml in a folder of its own."""

    title: str = parameter(text="title in one line")
    order: int = parameter(99, ge=0, text="place in the list of lessons")
    water: list[WaterOf] = parameter(list, max_length=WATERS, text="simulations, side by side")
    board: str = parameter("", text="board without simulations: kernels, contours or ladder")
    slider: list[SliderOf] = parameter(list, max_length=SLIDERS, text="sliders")
    predict: Predict = parameter(text="question at the start")
    do: list[Task] = parameter(min_length=1, max_length=4, text="tasks in their order")
    why: Why = parameter(text="explanation at the end")
