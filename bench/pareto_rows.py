"""Results of the sweep of speed against error: a setting, and its figures over the starts."""

import math
import os
import re
import statistics
from collections.abc import Callable
from dataclasses import dataclass

from bench.tables import BETWEEN, META

# First cells of a row: the setting.
HEADS = ("method", "water", "resolution", "changes")
FIELDS = ("case", *HEADS)
TIME = "wall_per_simulated"
# Largest mean number of cores that other processes keep busy during a timed run, in addition to the
# cores that the run leaves free.
QUIET = 0.1
# Which of the values over the starts to take: statistics.median, min or max.
Pick = Callable[[list[float]], float]


def place_of(measured: str) -> tuple[int, str]:
    """Returns the number of CPU threads and the date of a measurement."""
    (threads,) = re.findall(r"threads: (\d+)", measured)
    return int(threads), measured.rpartition("; ")[2]


def disturbed(measured: str, others: float) -> bool:
    """Returns True if other processes kept so many cores busy, `others`, that the run's time is
    unreliable."""
    return others > QUIET + (os.cpu_count() or 1) - place_of(measured)[0]


@dataclass(frozen=True, eq=False)
class Result:
    """A setting of a case. figures: values over the starts by name; runs: number of starts;
    measured: place and date of the last; failure: messages of failed runs."""

    figures: dict[str, list[float]]
    runs: int
    measured: str
    failure: str
    case: str
    method: str
    water: str
    resolution: str
    changes: str

    def of(self, name: str, pick: Pick = statistics.median) -> float:
        """Returns a figure, by default its median over the starts; NaN if it is missing."""
        return pick(self.figures[name]) if name in self.figures else math.nan

    @property
    def time(self) -> float:
        """Median of the elapsed time per simulated time (-)."""
        return self.of(TIME)


def grouped(rows: list[dict]) -> list[Result]:
    """Returns the result of each setting. Failed runs count only in `failure`."""
    found: dict[tuple, list[dict]] = {}
    for row in rows:
        found.setdefault((row["table"], *row["case"].split(BETWEEN)), []).append(row)
    return [_result(dict(zip(FIELDS, key, strict=True)), own) for key, own in found.items()]


def _result(setting: dict[str, str], rows: list[dict]) -> Result:
    good = [row for row in rows if not row.get("failure")] or rows
    figures: dict[str, list[float]] = {}
    for row in good:
        for name, text in row.items():
            if name not in META and text:
                figures.setdefault(name, []).append(float(text))
    failures = "; ".join(row["failure"] for row in rows if row.get("failure"))
    return Result(figures, len(good), good[-1]["measured"], failures, **setting)
