"""Arrays that take long to compute, kept between runs in the user's cache folder.

The mesh of a body is needed at each start, in each process. Reading its file takes 0.3 s, of which
most is the import of trimesh, sampling it 0.2 to 0.7 s, and colouring it 0.4 s. Reading the kept
arrays takes some milliseconds.
"""

import contextlib
import hashlib
import os
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from msph import user_cache

# Largest number of files, of some megabytes at most; the oldest are removed.
MOST = 40


def kept(compute: Callable[[], list[np.ndarray]], *given: Any) -> list[np.ndarray]:
    """Returns the arrays of compute(), which depend on the program's code and on what is given:
    arrays, and values that differ where their repr() does."""
    digest = hashlib.sha256(code().encode())
    for each in given:
        array = isinstance(each, np.ndarray)
        digest.update(f"{(each.dtype.str, each.shape) if array else each!r};".encode())
        digest.update(np.ascontiguousarray(each).tobytes() if array else b"")
    path = user_cache.file().parent / "arrays" / f"{digest.hexdigest()}.npz"
    # Damaged files raise errors of many kinds, for example of encryption and of memory.
    with contextlib.suppress(Exception), np.load(path) as at:
        return [at[name] for name in at.files]
    found = compute()
    with contextlib.suppress(OSError):
        _write(path, found)
    return found


@cache
def code() -> str:
    """Returns a digest of the paths, sizes and modification times of this program's modules."""
    files = [(str(f), f.stat()) for f in sorted(Path(__file__).parent.rglob("*.py"))]
    text = repr([(name, about.st_size, about.st_mtime_ns) for name, about in files])
    return hashlib.sha256(text.encode()).hexdigest()


def _write(path: Path, arrays: list[np.ndarray]) -> None:
    """Writes a file and removes the oldest ones. The file is renamed when it is complete, since
    another process may read or write it at the same time."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f"{path.stem}.{os.getpid()}.part")
    with part.open("wb") as file:
        np.savez(file, *arrays)
    part.replace(path)
    files = sorted(path.parent.iterdir(), key=lambda f: f.stat().st_mtime)
    for old in files[:-MOST]:
        old.unlink(missing_ok=True)
