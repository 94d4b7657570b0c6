"""Boards: flat drawings, labelled, that a lesson's sliders change, and the numbers in them."""

import importlib
from typing import Any, Protocol

# By name the module of each, whose Board draws it.
MODULES = {
    "kernels": "msph.lesson.board_kernels",
    "contours": "msph.lesson.board_contours",
    "ladder": "msph.lesson.board_ladder",
}


class Board(Protocol):
    """INPUTS: what sliders can move, each with its unit and its value where none does. NUMBERS:
    what expressions can read, each with its unit."""

    INPUTS: dict[str, tuple[str, float]]
    NUMBERS: dict[str, str]

    def draw(self, values: dict[str, float], size: tuple[int, int]) -> Any:
        """The drawing for these inputs: pixels (height, width, 3) uint8, first row at the top."""

    def numbers(self, values: dict[str, float]) -> dict[str, float]:
        """The numbers for these inputs."""


def board_of(name: str) -> Any:
    """The board of that name; KeyError where there is none."""
    return importlib.import_module(MODULES[name]).Board()
