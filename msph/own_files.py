"""Files of earlier runs may be written over; files that a run did not write may not.

A run writes its scene beside what it makes, with a digest of the text in the first line. Outputs
beside an untouched scene of that kind are a run's.
"""

import hashlib
import re
from collections.abc import Iterable
from pathlib import Path

from msph.errors import BadInputError

HEAD = re.compile(r"# written by msph, sha256 ([0-9a-f]{16})\n")


class ForeignFileError(BadInputError):
    """A file would be written over that no run wrote."""


def sealed(text: str) -> str:
    """The text under a line that tells whether it was changed since."""
    return f"# written by msph, sha256 {_digest(text)}\n{text}"


def untouched(path: Path) -> bool:
    """Whether a file is as a run wrote it."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return False
    head = HEAD.match(text)
    return head is not None and head[1] == _digest(text[head.end() :])


def guard(scene: Path, outputs: Iterable[Path], force: bool) -> None:
    """Raises ForeignFileError if the scene that a run writes, or an output beside it, is a file
    that no run wrote, unless by `force`."""
    if force or untouched(scene):
        return
    for path in (scene, *outputs):
        if path.exists():
            raise ForeignFileError(f"{path}: was not written by a run; --force writes over it")


def replace(path: Path, text: str) -> None:
    """Writes beside and renames: a disk that fills leaves what there was."""
    beside = path.with_name(f"{path.name}.part")
    try:
        beside.write_text(text, encoding="utf-8")
        beside.replace(path)
    except (OSError, ValueError):
        beside.unlink(missing_ok=True)
        raise


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:16]
