"""Tables of numbers that grow while a run goes on: CSV with units in its head."""

import csv
import math
from collections.abc import Iterable
from pathlib import Path


class Table:
    """A CSV file; each row is written at once, so a run that fails leaves the rows it had.

    heads: "name [unit]" of each column. What is not known (NaN) is an empty cell.
    """

    def __init__(self, path: Path, heads: list[str]):
        self.path = path
        path.write_text("")
        self._append(heads)

    def write(self, values: Iterable[float]) -> None:
        self._append(["" if math.isnan(v) else f"{v:.9g}" for v in values])

    def _append(self, cells: list[str]) -> None:
        with open(self.path, "a", newline="", encoding="utf-8") as file:
            csv.writer(file, lineterminator="\n").writerow(cells)
