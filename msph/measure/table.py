"""CSV tables written row by row during a run, with units in the column names."""

import csv
import math
import os
import re
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from msph.errors import BadInputError, LostOutputError
from msph.own_files import writing, written

# Tolerance of times [s] in a table, from its number of digits.
ROUNDING = 1e-6
# Units of probes in column names.
UNITS = ("Pa", "m", "m_per_s", "m3_per_s", "N", "N_m")


def column(head: str) -> str:
    """Returns the column name of a head "name [unit]", a valid identifier.

    Factors of a unit are joined by _, powers follow their unit, and denominators follow "per":
    "gravity_y [m/s^2]" becomes gravity_y_m_per_s2. Quantities without a unit [-] get no suffix.
    """
    name, _, unit = head.removesuffix("]").partition(" [")
    if unit in ("", "-"):
        return name
    parts = re.sub(r"^1/", "per_", unit).replace("/", "_per_").replace("^", "").replace(" ", "_")
    return f"{name}_{parts}"


def parts(name: str) -> tuple[str, str]:
    """Splits the column name of a probe into name and unit, the longest matching one of UNITS."""
    unit = max((u for u in UNITS if name.endswith(f"_{u}")), key=len)
    return name.removesuffix(f"_{unit}"), unit


def read(path: Path) -> dict[str, np.ndarray]:
    """Returns the columns of a table by name, (rows,) each; empty cells are NaN."""
    with open(path, newline="", encoding="utf-8") as file:
        names, *rows = list(csv.reader(file)) or [[]]
    numbers = np.array([[float(cell or "nan") for cell in row] for row in rows])
    return dict(zip(names, numbers.reshape(len(rows), len(names)).T, strict=True))


class TableError(BadInputError):
    """A table that a resumed run cannot extend."""


class Table:
    """A CSV file to which each row is written immediately, so that a failed run keeps its rows.

    heads: "name [unit]" of each column; the first is the time [s]. NaN is an empty cell. until [s]:
    rows of the existing file up to that time are `kept`, and the file is unchanged until a row is
    written; None starts a new file. Raises TableError if the existing columns differ,
    LostOutputError if a row cannot be written.
    """

    def __init__(self, path: Path, heads: list[str], until: float | None = None):
        self.path, self.kept = path, np.empty((0, len(heads)))
        self.names = names = [column(head) for head in heads]
        self._begun = False
        if until is None:
            self._begin()
        elif written(path):
            found = read(path)
            if list(found) != names:
                raise TableError(f"{path}: its columns differ from this run's")
            rows = np.column_stack(list(found.values()))
            self.kept = rows[rows[:, 0] <= until + ROUNDING]

    def write(self, values: Iterable[float]) -> None:
        if not self._begun:
            self._begin()
        self._append(["" if math.isnan(v) else f"{v:.9g}" for v in values])

    def _begin(self) -> None:
        self._begun = True
        with writing(self.path):
            self.path.write_text("")
        self._append(self.names)
        for row in self.kept:
            self.write(row)

    def _append(self, cells: list[str]) -> None:
        length = self.path.stat().st_size
        try:
            with (
                writing(self.path),
                open(self.path, "a", newline="", encoding="utf-8") as file,
            ):
                csv.writer(file, lineterminator="\n").writerow(cells)
        except LostOutputError:
            # A full disk must not leave an incomplete row.
            os.truncate(self.path, length)
            raise
