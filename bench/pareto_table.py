"""Rows of the sweep of speed against error, one for each run."""

import dataclasses
import datetime
import math
import os
import statistics

from bench.cases.case import Setting
from msph.measure.machine import machine

KEYS = ["case", *(f.name for f in dataclasses.fields(Setting))]
# Columns of the place and date of a run.
WHERE = ["arch", "threads", "machine", "date"]
# Largest mean number of cores that other processes keep busy during a timed run, in addition to the
# cores that the run leaves free.
QUIET = 0.1


def key(row: dict) -> tuple[str, ...]:
    """Returns the values that identify a row, numbers as written to the table."""
    return tuple("" if row.get(k) is None else str(row[k]) for k in KEYS)


def row_of(case: str, setting: Setting, arch: str, threads: int, found: dict) -> dict:
    """Returns a row of the table: case, setting, CPU threads, machine, date and figures."""
    numbers = {k: v if isinstance(v, str) else f"{v:.5g}" for k, v in found.items()}
    today = datetime.date.today().isoformat()
    where = {"arch": arch, "threads": threads, "machine": machine(), "date": today}
    return {"case": case, **dataclasses.asdict(setting), **where, **numbers}


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
    """Returns a row for each setting: the medians of its figures over the starts, with the least
    and the largest values as the rows `low` and `high`, and the number of `starts`. Failed runs
    count only in `failure`."""
    found: dict[tuple, list[dict]] = {}
    for row in rows:
        found.setdefault(key({**row, "start": ""}), []).append(row)
    return [_group(own) for own in found.values()]


def _group(rows: list[dict]) -> dict:
    good = [row for row in rows if not row.get("failure")] or rows
    figures = {name for row in good for name in row} - {*KEYS, *WHERE, "failure"}
    known = {
        name: [number(r, name) for r in good if r.get(name) not in (None, "")] for name in figures
    }
    known = {name: values for name, values in known.items() if values}
    low, median, high = (
        {name: pick(values) for name, values in known.items()}
        for pick in (min, statistics.median, max)
    )
    failures = [row["failure"] for row in rows if row.get("failure")]
    first = {name: good[-1].get(name) for name in (*KEYS, *WHERE)}
    more = {"low": low, "high": high, "starts": len(good), "failure": "; ".join(failures)}
    return {**first, **median, **more}


def disturbed(row: dict) -> bool:
    """Returns True if other processes used so much CPU time that the run's time is unreliable."""
    cores = os.cpu_count() or 1
    return number(row, "others") > QUIET + cores - int(row.get("threads") or cores)
