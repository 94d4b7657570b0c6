"""Rows of the sweep of speed against error: a run each."""

import dataclasses
import datetime
import math

from bench.cases.case import Setting
from msph.measure.machine import machine

KEYS = ["case", *(f.name for f in dataclasses.fields(Setting))]
# Cores that other processes may keep busy beside a run whose time counts.
QUIET = 0.1


def key(row: dict) -> tuple[str, ...]:
    """What tells a row from others; numbers as they are written to the table."""
    return tuple("" if row.get(k) is None else str(row[k]) for k in KEYS)


def row_of(case: str, setting: Setting, arch: str, found: dict) -> dict:
    """A table's row: what was run, when, where, and what was found."""
    numbers = {k: v if isinstance(v, str) else f"{v:.5g}" for k, v in found.items()}
    today = datetime.date.today().isoformat()
    where = {"arch": arch, "machine": machine(), "date": today}
    return {"case": case, **dataclasses.asdict(setting), **where, **numbers}


def number(row: dict, name: str) -> float:
    """A row's figure, NaN where there is none."""
    text = row.get(name)
    return float(text) if text not in (None, "") else math.nan


def disturbed(row: dict) -> bool:
    """Whether other processes took so much beside a run that its time says little."""
    return number(row, "others") > QUIET
