"""Boards: flat drawings, labelled, that a lesson's sliders change, and the numbers in them."""

import importlib
from typing import Any, NamedTuple, Protocol

# By name the module of each, whose Board draws it.
MODULES = {
    "kernels": "msph.lesson.board_kernels",
    "contours": "msph.lesson.board_contours",
    "ladder": "msph.lesson.board_ladder",
}


class Input(NamedTuple):
    """Unit, value where no slider moves it, least and largest value."""

    unit: str
    start: float
    lo: float
    hi: float


class Board(Protocol):
    """INPUTS: what sliders can move. NUMBERS: what expressions can read, each with its unit."""

    INPUTS: dict[str, Input]
    NUMBERS: dict[str, str]

    def draw(self, values: dict[str, float], size: tuple[int, int]) -> Any:
        """The drawing for these inputs: pixels (height, width, 3) uint8, first row at the top."""

    def numbers(self, values: dict[str, float]) -> dict[str, float]:
        """The numbers for these inputs."""


def board_of(name: str) -> Any:
    """The board of that name; KeyError where there is none."""
    return importlib.import_module(MODULES[name]).Board()
