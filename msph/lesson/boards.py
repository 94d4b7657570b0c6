"""Boards: diagrams with numbers that depend on a lesson's sliders, used without a simulation."""

import importlib
from typing import Any, NamedTuple, Protocol

# Module of each board's class Board, by name.
MODULES = {
    "kernels": "msph.lesson.board_kernels",
    "contours": "msph.lesson.board_contours",
    "ladder": "msph.lesson.board_ladder",
}


class Input(NamedTuple):
    """An input of a board: unit, default, least and largest value."""

    unit: str
    start: float
    lo: float
    hi: float


class Board(Protocol):
    """A board. INPUTS: inputs by slider name. NUMBERS: units of its numbers, by name."""

    INPUTS: dict[str, Input]
    NUMBERS: dict[str, str]

    def draw(self, values: dict[str, float], size: tuple[int, int]) -> Any:
        """Returns the diagram for the inputs: (height, width, 3) uint8, first row at the top."""

    def numbers(self, values: dict[str, float]) -> dict[str, float]:
        """Returns the numbers for the inputs."""


def board_of(name: str) -> Any:
    """Returns the board of a name in MODULES."""
    return importlib.import_module(MODULES[name]).Board()
