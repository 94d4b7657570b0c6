"""Output files: written completely or reported as lost, and never over existing files.

A command claims its output files before it computes anything. A claim fails if a file exists,
unless --force is given. writing() and replacing() also claim files, so that every write follows
this rule.
"""

import contextlib
import errno
import glob
import os
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path

from msph.errors import BadInputError, LostOutputError

# Free space [bytes] below which a failed write is reported as a full disk: encoders give no reason.
FULL_DISK = 1 << 20

# Files that the running command may write.
_claimed: set[Path] = set()


class ExistingFileError(BadInputError):
    """An output file that existed before the command."""


class OutputError(BadInputError):
    """An output that cannot be written."""


def begin() -> None:
    """Drops all claims at the start of a command."""
    _claimed.clear()


def claim(paths: Iterable[Path], force: bool = False) -> None:
    """Claims all files for the running command, or none. Raises ExistingFileError if one exists
    and was not claimed before, unless `force`; devices such as /dev/null do not count."""
    places = {path.resolve(): path for path in paths}
    for place, path in places.items():
        if place not in _claimed and place.is_file() and not force:
            raise ExistingFileError(f"{path}: exists; --force overwrites it")
    _claimed.update(places)


def make_writable(path: Path) -> None:
    """Creates the folder of an output, and raises OutputError if the file is not writable."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        new = not path.exists()
        with open(path, "ab"):
            pass
        if new:
            path.unlink()
    except FileExistsError:
        raise OutputError(f"{path.parent}: is a file, not a folder") from None
    except OSError as error:
        problem = error.strerror or "cannot be written"
        raise OutputError(f"{path}: {problem[0].lower()}{problem[1:]}") from None


def free_stem(folder: Path, stem: str) -> str:
    """Returns `stem`, or `stem` with the first number from 2 such that no file of the folder has
    this name with any suffix."""
    found, number = stem, 1
    while any(folder.glob(f"{glob.escape(found)}.*")):
        number += 1
        found = f"{stem}_{number}"
    return found


@contextlib.contextmanager
def writing(path: Path) -> Iterator[None]:
    """Context for writing a file. Raises ExistingFileError; turns an OSError into a LostOutputError
    that names the file."""
    claim([path])
    try:
        yield
    except OSError as error:
        full = shutil.disk_usage(path.parent).free < FULL_DISK
        problem = os.strerror(errno.ENOSPC) if full else str(error.strerror or error)
        line = problem.strip().splitlines()[0]
        raise LostOutputError(f"{path}: {line[0].lower()}{line[1:]}") from None


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yields a temporary file in the same folder, which replaces `path` on success and is removed
    on failure. Raises ExistingFileError and LostOutputError."""
    with writing(path):
        handle, name = tempfile.mkstemp(path.suffix, f".{path.stem}_", path.parent)
        os.close(handle)
        temporary = Path(name)
        try:
            yield temporary
            temporary.chmod(0o666 & ~_umask())
            temporary.replace(path.resolve())
        finally:
            temporary.unlink(missing_ok=True)


def replace(path: Path, text: str) -> None:
    """Writes a text file completely or not at all. Raises ExistingFileError, LostOutputError."""
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
