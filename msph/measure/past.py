"""Earlier measurements of a resumed run."""

import math
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import psutil

from msph.errors import BadInputError
from msph.fluid.checkpoint import numbers
from msph.measure.entry import SUM, Entry
from msph.parameter import LONGEST

# Fields of an entry that are sums since the start.
SUMS = [name for name, marks in Entry.annotated().items() if SUM in marks]


class CheckpointError(BadInputError):
    """A file that is not a checkpoint, or a checkpoint later than the end of the run."""

    @classmethod
    def beyond(cls, since: float, duration: float) -> "CheckpointError":
        """Returns the error of a checkpoint at `since` [s] for a run of `duration` [s]."""
        return cls(
            f"the checkpoint is at {since:g} s and the run ends at {duration:g} s; "
            "--seconds sets a later end"
        )


def time_of(checkpoint: Path) -> float:
    """Returns the simulated time [s] of a checkpoint. Raises CheckpointError."""
    return _head(checkpoint)[0]


def particles_in(checkpoint: str | None) -> int:
    """Returns the number of particles of a checkpoint, 0 without one. Raises CheckpointError."""
    return _head(Path(checkpoint))[1] if checkpoint else 0


def _head(checkpoint: Path) -> tuple[float, int]:
    """Returns the time [s] and the number of particles of a checkpoint."""
    try:
        state = read_state(checkpoint)
        return float(numbers(state, "time", (), 0.0, LONGEST)), len(state["x"])
    except (KeyError, TypeError, ValueError):
        raise CheckpointError(f"{checkpoint.name}: is not a checkpoint") from None


def read_state(path: Path) -> dict[str, np.ndarray]:
    """Returns the arrays of an .npz file. Raises ValueError with one line for a file that is none,
    or does not fit into the free memory."""
    try:
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
            size, free = sum(m.file_size for m in members), psutil.virtual_memory().available
            if size > free:
                raise ValueError(f"holds {size / 2**30:.1f} GiB; {free / 2**30:.1f} GiB are free")
            return {m.filename.removesuffix(".npy"): _array(archive, m) for m in members}
    except Exception as error:
        # A damaged file raises errors of a dozen types, from zipfile, its decoders and numpy.
        reason = " ".join(str(error).split()) or type(error).__name__
        raise ValueError(reason) from None


def _array(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> np.ndarray:
    """Returns an array of an .npz file; allocated after a check of its header."""
    with archive.open(member) as file:
        if np.lib.format.read_magic(file) != (1, 0):
            raise ValueError(f"{member.filename}: unknown version of the array")
        shape, _, kind = np.lib.format.read_array_header_1_0(file)
        if kind.hasobject or math.prod(shape) * kind.itemsize > member.file_size:
            raise ValueError(f"{member.filename}: has no {shape} numbers")
    with archive.open(member) as file:
        return np.lib.format.read_array(file, allow_pickle=False)


def continued(entry: Entry, before: Entry | None) -> Entry:
    """Returns the entry with its sums continued from the last entry before the run was resumed."""
    if before is None:
        return entry
    return replace(entry, **{k: getattr(entry, k) + getattr(before, k) for k in SUMS})
