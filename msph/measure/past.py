"""What a run that is gone on with has measured before."""

import zipfile
import zlib
from dataclasses import fields, replace
from pathlib import Path
from typing import get_args

import numpy as np

from msph.errors import BadInputError
from msph.measure.entry import Entry
from msph.measure.survey import Survey

# Sums since the start of an entry: a run that is gone on with begins them anew.
SUMS = (
    *("internal_impulse", "internal_angular_impulse", "wall_impulse", "body_impulse"),
    *("wall_work", "user_impulse", "user_work", "tilt_work", "merge_loss"),
)


# What reading a file raises that is no archive of arrays, or an empty one, or a cut one.
UNREADABLE = (
    *(ValueError, TypeError, AttributeError, OSError, EOFError),
    *(zipfile.BadZipFile, zlib.error),
)


class CheckpointError(BadInputError):
    """A file that is no checkpoint, or one beyond the end of the run."""

    @classmethod
    def beyond(cls, since: float, duration: float) -> "CheckpointError":
        """The error of a checkpoint of the time `since` [s] in a run of `duration` [s]."""
        return cls(
            f"the checkpoint is at {since:g} s and the run ends at {duration:g} s; "
            "--seconds sets a later end"
        )


def time_of(checkpoint: Path) -> float:
    """Simulated time [s] of a checkpoint. Raises CheckpointError."""
    try:
        with np.load(checkpoint) as state:
            if state.zip.testzip() is not None:
                raise ValueError("a member is damaged")
            return float(state["time"])
    except (*UNREADABLE, KeyError):
        raise CheckpointError(f"{checkpoint.name}: is no checkpoint") from None


def entries(rows: np.ndarray) -> list[Entry]:
    """Of the rows (n, columns) of a ledger, whose first columns are those of an entry."""
    found = []
    for row in rows:
        values, place = {}, 0
        for field in fields(Entry):
            kind, _ = get_args(field.type)
            if kind is np.ndarray:
                values[field.name] = row[place : place + 3].copy()
                place += 3
            else:
                values[field.name] = kind(row[place])
                place += 1
        found.append(Entry(**values))
    return found


def surveys(rows: np.ndarray, rest_volume: float) -> list[Survey]:
    """Of a ledger's rows (n, columns) whose last four columns are Survey.row(); rest_volume [m^3]
    of the water. Rows without a survey are left out."""
    # Here, as in survey().
    from msph.measure.bulk import BulkDensity

    return [
        Survey(row[0], row[-4], row[-4] / rest_volume - 1.0, BulkDensity(*row[-3:], 0))
        for row in rows
        if np.isfinite(row[-4:]).any()
    ]


def after(entry: Entry, before: Entry | None) -> Entry:
    """The entry with its sums continued from the last one before the run was gone on with."""
    if before is None:
        return entry
    return replace(entry, **{k: getattr(entry, k) + getattr(before, k) for k in SUMS})
