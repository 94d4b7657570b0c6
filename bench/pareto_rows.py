"""Rows of the sweep of speed against error: settings, and medians over their starts."""

import math
import os
import re
import statistics

from bench.tables import BETWEEN, META

# First cells of a row: the setting.
HEADS = ("method", "water", "resolution", "changes")
KEYS = ("case", *HEADS)
# Largest mean number of cores that other processes keep busy during a timed run, in addition to the
# cores that the run leaves free.
QUIET = 0.1


def place_of(row: dict) -> tuple[int, str]:
    """Returns the number of CPU threads and the date of a row."""
    (threads,) = re.findall(r"threads: (\d+)", row["measured"])
    return int(threads), row["measured"].rpartition("; ")[2]


def number(row: dict, name: str) -> float:
    """Returns a figure of a row, NaN if it is missing."""
    text = row.get(name)
    return float(text) if text not in (None, "") else math.nan


def low(row: dict, name: str) -> float:
    """Returns the least value of a figure over the starts of a grouped row."""
    return number(row["low"], name)


def high(row: dict, name: str) -> float:
    """Returns the largest value of a figure over the starts of a grouped row."""
    return number(row["high"], name)


def grouped(rows: list[dict]) -> list[dict]:
    """Returns a row for each setting: its cells, the medians of its figures over the starts, with
    the least and the largest values as the rows `low` and `high`, and the number of `starts`.
    Failed runs count only in `failure`."""
    found: dict[tuple, list[dict]] = {}
    for row in rows:
        found.setdefault((row["table"], *row["case"].split(BETWEEN)), []).append(row)
    return [_group(dict(zip(KEYS, key, strict=True)), own) for key, own in found.items()]


def _group(setting: dict[str, str], rows: list[dict]) -> dict:
    good = [row for row in rows if not row.get("failure")] or rows
    figures = {name for row in good for name in row} - set(META)
    known = {
        name: [number(r, name) for r in good if r.get(name) not in (None, "")] for name in figures
    }
    known = {name: values for name, values in known.items() if values}
    low, median, high = (
        {name: pick(values) for name, values in known.items()}
        for pick in (min, statistics.median, max)
    )
    failures = [row["failure"] for row in rows if row.get("failure")]
    more = {"low": low, "high": high, "starts": len(good), "failure": "; ".join(failures)}
    return {**setting, "measured": good[-1]["measured"], **median, **more}


def disturbed(row: dict) -> bool:
    """Returns True if other processes used so much CPU time that the run's time is unreliable."""
    free = (os.cpu_count() or 1) - place_of(row)[0]
    return number(row, "others") > QUIET + free
