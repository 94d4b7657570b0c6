"""Output files of a run: written atomically, and never over files of other origin.

A run writes its scene next to its outputs, with a digest of the text in the first line. Outputs
next to a scene file with a matching digest belong to a run and may be overwritten.
"""

import contextlib
import errno
import hashlib
import os
import re
import shutil
from collections.abc import Iterable, Iterator
from pathlib import Path

from msph.errors import BadInputError, LostOutputError

DIGEST_LINE = re.compile(r"# written by msph, sha256 ([0-9a-f]{16})\n")
# Free space on a disk [bytes] below which a failed write is reported as a full disk: encoders give
# no reason.
FULL_DISK = 1 << 20


class ForeignFileError(BadInputError):
    """Refusal to overwrite a file that no run has written."""


def with_digest(text: str) -> str:
    """Returns the text below a line with its digest."""
    return f"# written by msph, sha256 {_digest(text)}\n{text}"


def is_unmodified(path: Path) -> bool:
    """Returns True if a run wrote the file and nothing has changed it since."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return False
    head = DIGEST_LINE.match(text)
    return head is not None and head[1] == _digest(text[head.end() :])


def check_overwrite(scene: Path, outputs: Iterable[Path], force: bool) -> None:
    """Raises ForeignFileError if the scene file of a run, or an output next to it, exists and was
    not written by a run, unless `force`."""
    if force or is_unmodified(scene):
        return
    for path in (scene, *outputs):
        if path.exists():
            raise ForeignFileError(f"{path}: was not written by a run; --force overwrites it")


@contextlib.contextmanager
def writing(path: Path) -> Iterator[None]:
    """Context for writing a file: turns an OSError into a LostOutputError that names the file."""
    try:
        yield
    except OSError as error:
        full = shutil.disk_usage(path.parent).free < FULL_DISK
        problem = os.strerror(errno.ENOSPC) if full else str(error.strerror or error)
        line = problem.strip().splitlines()[0]
        raise LostOutputError(f"{path}: {line[0].lower()}{line[1:]}") from None


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yields a temporary file to write, which replaces `path` on success and is removed on failure.
    Raises LostOutputError."""
    new = path.with_name(f"new_{path.name}")
    try:
        with writing(path):
            yield new
            new.replace(path)
    finally:
        new.unlink(missing_ok=True)


def replace(path: Path, text: str) -> None:
    """Writes a text file completely or not at all. Raises LostOutputError."""
    with replacing(path) as new:
        new.write_text(text, encoding="utf-8")


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:16]
