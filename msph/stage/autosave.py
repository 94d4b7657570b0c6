"""Autosave of a session in a window: a file in the user's cache folder, from which a later session
continues after a crash."""

import contextlib
import json
import os
import threading
import time
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import psutil
from pydantic import TypeAdapter

from msph import user_cache
from msph.constants import VERSION
from msph.measure.past import read_state
from msph.scene.errors import SceneError
from msph.stage.choice import Choice, SceneArguments, full_name
from msph.stage.loop import Witness
from msph.stage.recorded_input import Header
from msph.stage.row import Row
from msph.stage.show import SESSION
from msph.stage.window import ClosedError

# Wall-clock time between two files [s].
INTERVAL = 5.0
PREFIX = "session_"
# Normal ends of a session by an exception.
ENDINGS = (ClosedError, KeyboardInterrupt)
# What the file of a session says of it: what it runs, and live parameters changed by the user.
SAVED = TypeAdapter(tuple[Header, dict[str, float]])


@contextlib.contextmanager
def session_file() -> Iterator[Path]:
    """Context with the path of this session's file, which is removed at the end, except after an
    error."""
    path = user_cache.file().parent / f"{PREFIX}{os.getpid()}_{time.time_ns()}.npz"
    try:
        yield path
    except BaseException as error:
        if isinstance(error, ENDINGS):
            path.unlink(missing_ok=True)
        raise
    path.unlink(missing_ok=True)


class Autosaver(Witness):
    """Saves the state of the simulation every INTERVAL; another thread writes a copy of it. header:
    what the session runs."""

    def __init__(self, path: Path, header: Header):
        self.path, self.header = path, header
        self.last, self.time = time.perf_counter(), 0.0
        self.writer: threading.Thread | None = None

    def observe(self, row: Row) -> None:
        lead, now = row.lead, time.perf_counter()
        busy = self.writer is not None and self.writer.is_alive()
        if busy or now - self.last < INTERVAL or lead.simulation.time == self.time:
            return
        self.last, self.time = now, lead.simulation.time
        about = json.dumps([asdict(self.header), lead.changes()])
        state = {**lead.simulation.state(), SESSION: about}
        self.writer = threading.Thread(target=self._write, args=(state,))
        self.writer.start()

    def _write(self, state: dict[str, Any]) -> None:
        part = self.path.with_suffix(".part")
        # A session runs on where the cache cannot be written.
        with contextlib.suppress(OSError):
            part.parent.mkdir(parents=True, exist_ok=True)
            with open(part, "wb") as file:
                np.savez(file, **state)
            part.replace(self.path)


def lost_session(arguments: SceneArguments) -> Choice | None:
    """Returns the last session that ended by a crash and can go on with these arguments."""
    for path in sorted(_left(), key=lambda p: p.stat().st_mtime, reverse=True):
        # Damaged files, other versions, and scenes that are gone or called otherwise.
        with contextlib.suppress(ValueError, KeyError, SceneError):
            header, changes = SAVED.validate_json(str(read_state(path)[SESSION]))
            same = header.overrides == arguments.overrides_of(full_name(header.scene))
            if same and header.msph == VERSION:
                return Choice(header.scene, header.quality, changes, resume=path)
    return None


def offer(lost: Choice) -> str:
    """Returns the message that offers to continue a lost session."""
    assert lost.resume
    began = time.strftime("%H:%M", time.localtime(int(lost.resume.stem.split("_")[2]) / 1e9))
    return f"Enter continues {Path(lost.scene).stem} of {began}, any other key deletes it"


def forget() -> None:
    """Removes the files of all sessions that ended by a crash."""
    for path in _left():
        path.unlink(missing_ok=True)


def _left() -> list[Path]:
    """Returns the files of processes that have ended."""
    files = user_cache.file().parent.glob(f"{PREFIX}*")
    return [path for path in files if not _in_use(path)]


def _in_use(path: Path) -> bool:
    """Returns True if the process that wrote a file still runs; a new process may reuse its id."""
    try:
        process = psutil.Process(int(path.name.split("_")[1]))
        return process.create_time() <= path.stat().st_mtime
    except (psutil.NoSuchProcess, ValueError, OSError):
        return False
