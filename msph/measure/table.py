"""Tables of numbers that grow while a run goes on: CSV with units in the names of its columns."""

import csv
import math
import os
import re
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from msph.errors import BadInputError, LostOutputError
from msph.own_files import writing

# Times of rows and checkpoints differ by less [s]: digits of a table.
ROUNDING = 1e-6
# Units of probes, as column() writes them.
UNITS = ("Pa", "m", "m_per_s", "m3_per_s", "N", "N_m")


def column(head: str) -> str:
    """The name of a column from "name [unit]", fit to be an attribute of a data frame: name_unit.

    Factors of a unit are joined by _, powers follow their unit, and what divides comes after
    "per": "gravity_y [m/s^2]" is gravity_y_m_per_s2. Quantities without a unit [-] have no suffix.
    """
    name, _, unit = head.removesuffix("]").partition(" [")
    if unit in ("", "-"):
        return name
    parts = re.sub(r"^1/", "per_", unit).replace("/", "_per_").replace("^", "").replace(" ", "_")
    return f"{name}_{parts}"


def parts(name: str) -> tuple[str, str]:
    """A probe's column as name and unit, the longest of UNITS that it ends in."""
    unit = max((u for u in UNITS if name.endswith(f"_{u}")), key=len)
    return name.removesuffix(f"_{unit}"), unit


def read(path: Path) -> dict[str, np.ndarray]:
    """Every column of a table by its name, (rows,) each; NaN where a cell is empty."""
    with open(path, newline="", encoding="utf-8") as file:
        names, *rows = list(csv.reader(file)) or [[]]
    numbers = np.array([[float(cell or "nan") for cell in row] for row in rows])
    return dict(zip(names, numbers.reshape(len(rows), len(names)).T, strict=True))


def energy_less_work(ledger: dict[str, np.ndarray]) -> np.ndarray:
    """Mechanical energy [J] less the work done from outside, of each row of a ledger: without
    dissipation it stays what it was."""
    given = ledger["wall_work_J"] + ledger["user_work_J"] + ledger["tilt_work_J"]
    return ledger["kinetic_J"] + ledger["potential_J"] - given


class TableError(BadInputError):
    """A table that cannot be gone on with."""


class Table:
    """A CSV file; each row is written at once, so a run that fails leaves the rows it had.

    heads: "name [unit]" of each column, whose name in the file is column(head); the first is the
    time [s]. What is not known (NaN) is an empty cell. until [s]: the table that there is keeps its
    rows up to that time, which are `kept`, and stays as it is until a row is written; None starts
    anew. Raises TableError for other columns,
    LostOutputError where a row cannot be written.
    """

    def __init__(self, path: Path, heads: list[str], until: float | None = None):
        self.path, self.kept = path, np.empty((0, len(heads)))
        self.names = names = [column(head) for head in heads]
        self._begun = False
        if until is None:
            self._begin()
        if until is not None and path.exists():
            found = read(path)
            if list(found) != names:
                raise TableError(f"{path}: its columns are not those of this run")
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
            # A disk that fills must leave whole rows.
            os.truncate(self.path, length)
            raise
