"""Files of a run: written whole or said to be lost, and never over files that no run wrote.

A run writes its scene beside what it makes, with a digest of the text in the first line. Outputs
beside an is_unmodified scene of that kind are a run's.
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

HEAD = re.compile(r"# written by msph, sha256 ([0-9a-f]{16})\n")
# Room on a disk [bytes] below which a write that fails does so for want of it: encoders do not say.
FULL_DISK = 1 << 20


class ForeignFileError(BadInputError):
    """A file would be written over that no run wrote."""


def with_digest(text: str) -> str:
    """The text under a line that tells whether it was changed since."""
    return f"# written by msph, sha256 {_digest(text)}\n{text}"


def is_unmodified(path: Path) -> bool:
    """Whether a file is as a run wrote it."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return False
    head = HEAD.match(text)
    return head is not None and head[1] == _digest(text[head.end() :])


def check_overwrite(scene: Path, outputs: Iterable[Path], force: bool) -> None:
    """Raises ForeignFileError if the scene that a run writes, or an output beside it, is a file
    that no run wrote, unless by `force`."""
    if force or is_unmodified(scene):
        return
    for path in (scene, *outputs):
        if path.exists():
            raise ForeignFileError(
                f"{path}: was not written by a run; --force of capture and measure"
            )


@contextlib.contextmanager
def writing(path: Path) -> Iterator[None]:
    """Within, a file is written: what the system refuses is a LostOutputError that names it."""
    try:
        yield
    except OSError as error:
        full = shutil.disk_usage(path.parent).free < FULL_DISK
        problem = os.strerror(errno.ENOSPC) if full else str(error.strerror or error)
        line = problem.strip().splitlines()[0]
        raise LostOutputError(f"{path}: {line[0].lower()}{line[1:]}") from None


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Within, the file given is written, which then takes the place of `path`: a disk that fills
    leaves what there was. Raises LostOutputError."""
    beside = path.with_name(f"new_{path.name}")
    try:
        with writing(path):
            yield beside
            beside.replace(path)
    finally:
        beside.unlink(missing_ok=True)


def replace(path: Path, text: str) -> None:
    """Writes a text file whole or not at all. Raises LostOutputError."""
    with replacing(path) as beside:
        beside.write_text(text, encoding="utf-8")


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:16]
