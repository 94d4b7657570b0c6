"""Rows of the sweep of speed against error, one for each run."""

import dataclasses
import datetime
import math

from bench.cases.case import Setting
from msph.measure.machine import machine

KEYS = ["case", *(f.name for f in dataclasses.fields(Setting))]
# Largest mean number of cores that other processes keep busy during a timed run.
QUIET = 0.1


def key(row: dict) -> tuple[str, ...]:
    """Returns the values that identify a row, numbers as written to the table."""
    return tuple("" if row.get(k) is None else str(row[k]) for k in KEYS)


def row_of(case: str, setting: Setting, arch: str, found: dict) -> dict:
    """Returns a row of the table: case, setting, machine, date and figures."""
    numbers = {k: v if isinstance(v, str) else f"{v:.5g}" for k, v in found.items()}
    today = datetime.date.today().isoformat()
    where = {"arch": arch, "machine": machine(), "date": today}
    return {"case": case, **dataclasses.asdict(setting), **where, **numbers}


def number(row: dict, name: str) -> float:
    """Returns a figure of a row, NaN if it is missing."""
    text = row.get(name)
    return float(text) if text not in (None, "") else math.nan


def disturbed(row: dict) -> bool:
    """Returns True if other processes used so much CPU time that the run's time is unreliable."""
    return number(row, "others") > QUIET
