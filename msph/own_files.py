"""Output files: written whole or reported as lost, and never over files that existed before.

A command claims the files that it will write before it computes anything. A claim fails where a
file exists, unless the user gave --force. writing() and replacing() claim what was not claimed
before, so that no write goes around this rule.
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

# Free space [bytes] below which a failed write is reported as a full disk: encoders do not say.
FULL_DISK = 1 << 20

# Files that the running command may write.
_claimed: set[Path] = set()


class ExistingFileError(BadInputError):
    """An output file that existed before the command."""


def begin() -> None:
    """Drops all claims: a command begins."""
    _claimed.clear()


def claim(paths: Iterable[Path], force: bool = False) -> None:
    """Claims files for the running command, all of them or none. Raises ExistingFileError where one
    exists that was not claimed before, unless `force`. Devices such as /dev/null are no files."""
    places = {path.resolve(): path for path in paths}
    for place, path in places.items():
        if place not in _claimed and place.is_file() and not force:
            raise ExistingFileError(f"{path}: exists; --force overwrites it")
    _claimed.update(places)


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
    """Context in which a file is written. Raises ExistingFileError, and LostOutputError with the
    file's name for what the system refuses."""
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
    """Context that gives a temporary file in the same folder, which then replaces `path`: a full
    disk leaves the old file. Raises ExistingFileError and LostOutputError."""
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
    """Writes a text file whole or not at all. Raises ExistingFileError and LostOutputError."""
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
