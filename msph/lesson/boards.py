"""Boards: diagrams with numbers that depend on a lesson's sliders, used without a simulation."""

import importlib
from typing import Any, NamedTuple

# Module of each board's class Board, by name.
MODULES = {
    "kernels": "msph.lesson.board_kernels",
    "contours": "msph.lesson.board_contours",
    "ladder": "msph.lesson.board_ladder",
}


class Input(NamedTuple):
    """An input of a board: unit, default, least and largest value; names: texts of the values
    lo, lo + 1, ..., empty for a number."""

    unit: str
    start: float
    lo: float
    hi: float
    names: tuple[str, ...] = ()

    def name(self, value: float) -> str:
        """Returns the name of a value, "" for a number."""
        return self.names[round(value - self.lo)] if self.names else ""


def choice(names: tuple[str, ...], start: int = 0) -> Input:
    """Returns the input that selects one of these names, counted from 1; start: index from 0."""
    return Input("-", start + 1.0, 1.0, float(len(names)), names)


def board_of(name: str) -> Any:
    """Returns the board with a name in MODULES."""
    return importlib.import_module(MODULES[name]).Board()
