"""Output files: written completely or reported as lost, and never over existing files.

A command claims its output files before it computes anything: an empty file is created under each
name, in one operation of the file system, so that of two commands started together one is refused.
A claim fails if a file exists, unless --force is given. writing() and replacing() also claim
files, so that every write follows this rule. A claimed file is locked until the command has written
it or ends: an empty file that is not locked is left over from a killed command, and is free.
"""

import contextlib
import errno
import glob
import json
import os
import shutil
import stat
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from msph.errors import BadInputError, LostOutputError

try:
    import fcntl
except ImportError:  # Windows, where files that a killed command leaves need --force
    fcntl = None  # type: ignore[assignment]

# Free space [bytes] below which a failed write is reported as a full disk: encoders give no reason.
FULL_DISK = 1 << 20
# End of the name of the scene file that commands write next to their outputs.
SCENE_SUFFIX = ".scene.toml"

# Files that the running command may write, and those among them that its claims created, with the
# descriptors that lock them.
_claimed: set[Path] = set()
_created: dict[Path, int] = {}


class ExistingFileError(BadInputError):
    """An output file that existed before the command."""


class OutputError(BadInputError):
    """An output that cannot be written."""


def release() -> None:
    """Drops all claims at the end of a command, and removes claimed files without content."""
    _unlock(_created)
    _claimed.clear()


@contextlib.contextmanager
def replacing_all(paths: Iterable[Path]) -> Iterator[None]:
    """Context in which files may be written, in place of existing ones."""
    claim(paths, force=True)
    try:
        yield
    finally:
        release()


def claim(paths: Iterable[Path], force: bool = False, later: Iterable[Path] = ()) -> None:
    """Claims all files for the running command, or none, and creates their folders. Raises
    ExistingFileError if a file exists and was not claimed before, unless `force`; devices such as
    /dev/null do not count. Raises OutputError for a file that cannot be written.

    later: files that must not exist either, such as the frames of a recording, but are claimed when
    they are written.
    """
    new = list[Path]()
    frames = {place_of(path): path for path in later}
    try:
        for place, path in frames.items():
            if place not in _claimed and not force and os.path.isfile(place):
                raise ExistingFileError(f"{path}: exists; --force overwrites it")
        # In the same order in each command, so that one of two succeeds.
        places = {place_of(path): path for path in paths}
        for place in sorted(places.keys() - _claimed):
            if _create(place, places[place], force):
                new.append(place)
    except BadInputError:
        _unlock(new)
        raise
    _claimed.update(places, frames if force else ())


def _create(place: Path, path: Path, force: bool) -> bool:
    """Creates and locks an empty file, or locks one that a killed command left; returns False for
    an existing file that may be overwritten."""
    with _refusing(path.parent):
        place.parent.mkdir(parents=True, exist_ok=True)
    with _refusing(path):
        try:
            handle, created = os.open(place, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666), True
        except FileExistsError:
            if place.is_file() and place.stat().st_size > 0 and not force:
                raise ExistingFileError(f"{path}: exists; --force overwrites it") from None
            handle, created = os.open(place, os.O_APPEND | os.O_WRONLY), False
        if _lock(handle, place, created):
            _created[place] = handle
            return True
        os.close(handle)
        if place.is_file() and not force:
            raise ExistingFileError(f"{path}: exists; --force overwrites it")
        return False


def _lock(handle: int, place: Path, created: bool) -> bool:
    """Locks an open file; returns True if it is empty and no other command has claimed it."""
    if fcntl is None:
        return created
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:  # a file system without locks
        return created
    found = os.fstat(handle)
    # A rival may have written or replaced the file before it was locked.
    same = place.exists() and os.path.samestat(found, place.stat())
    return same and stat.S_ISREG(found.st_mode) and found.st_size == 0


@contextlib.contextmanager
def _refusing(path: Path) -> Iterator[None]:
    """Turns an OSError into an OutputError that names the path."""
    try:
        yield
    except FileExistsError:
        raise OutputError(f"{path}: is a file, not a folder") from None
    except OSError as error:
        problem = error.strerror or "cannot be written"
        raise OutputError(f"{path}: {problem[0].lower()}{problem[1:]}") from None


def place_of(path: Path) -> Path:
    """Returns the path without symbolic links, except in a loop of links, which cannot be opened.
    Raises OutputError for a name that no file can have."""
    try:
        return Path(os.path.realpath(path))
    except ValueError:
        raise OutputError(f"{path}: is not a file name") from None


def written(path: Path) -> bool:
    """Returns True if a file exists and is not a claimed one without content."""
    return path.exists() and not (place_of(path) in _created and path.stat().st_size == 0)


def _unlock(places: Iterable[Path]) -> None:
    """Unlocks files that claims created, and removes those without content."""
    for place in list(places):
        # The user may have removed the file or its folder.
        with contextlib.suppress(OSError):
            if place in _created and place.stat().st_size == 0:
                place.unlink()
        if place in _created:
            os.close(_created.pop(place))


def free_stem(folder: Path, stem: str) -> str:
    """Returns `stem`, or `stem` with the first number from 2 such that no file of the folder has
    this name with any suffix, and claims the scene file of this name."""
    found, number = stem, 1
    while True:
        if not any(folder.glob(f"{glob.escape(found)}.*")):
            with contextlib.suppress(ExistingFileError):
                claim([folder / f"{found}{SCENE_SUFFIX}"])
                return found
        number += 1
        found = f"{stem}_{number}"


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
    finally:
        if written(path):
            _unlock([place_of(path)])


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
            temporary.replace(place_of(path))
        finally:
            temporary.unlink(missing_ok=True)


def replace(path: Path, text: str) -> None:
    """Writes a text file completely or not at all. Raises ExistingFileError, LostOutputError."""
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_json(path: Path, data: Any) -> None:
    """Writes data as JSON, as replace() does; numbers that are not finite become null."""
    finite = json.loads(json.dumps(data), parse_constant=lambda _: None)
    replace(path, json.dumps(finite, indent=2, ensure_ascii=False) + "\n")


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
