"""Autosave of a session in a window: a file in the user's cache folder, from which a later session
continues after a crash."""

import contextlib
import json
import os
import time
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import asdict, dataclass, field, replace
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
from msph.stage.row import Row
from msph.stage.show import SESSION
from msph.stage.window import ClosedError

# Wall-clock time between two files [s].
INTERVAL = 5.0
PREFIX = "session_"
# Normal ends of a session by an exception.
ENDINGS = (ClosedError, KeyboardInterrupt)


@dataclass(frozen=True)
class About:
    """Description of a session: version of the program, time of the start, scene, quality,
    overrides on the command line, and live parameters changed by the user."""

    msph: str
    began: str
    scene: str
    quality: str
    overrides: tuple[str, ...]
    set: dict[str, float] = field(default_factory=dict)

    @classmethod
    def of(cls, choice: Choice, arguments: SceneArguments, began: str) -> "About":
        """Returns the description of a choice, without changes by the user."""
        names = full_name(choice.scene), choice.quality_now, arguments.overrides_of(choice.scene)
        return cls(VERSION, began, *names)


class Autosave:
    """File of this session. As a context it removes the file at the end, except after an error."""

    def __init__(self, path: Path | None = None):
        self.began = time.strftime("%H:%M")
        self.path = path or folder() / f"{PREFIX}{os.getpid()}_{time.time_ns()}.npz"
        self.writer = ThreadPoolExecutor(1)

    def __enter__(self) -> "Autosave":
        return self

    def __exit__(self, kind: type[BaseException] | None, *_) -> None:
        self.writer.shutdown()
        if kind is None or issubclass(kind, ENDINGS):
            self.path.unlink(missing_ok=True)

    def write(self, about: About, state: dict[str, Any]) -> Future:
        """Begins to write a state and its description."""
        return self.writer.submit(self._write, {**state, SESSION: json.dumps(asdict(about))})

    def _write(self, state: dict[str, Any]) -> None:
        part = self.path.with_suffix(".part")
        # A session runs on where the cache cannot be written.
        with contextlib.suppress(OSError):
            part.parent.mkdir(parents=True, exist_ok=True)
            with open(part, "wb") as file:
                np.savez(file, **state)
            part.replace(self.path)


class Autosaver(Witness):
    """Saves the state of the simulation every INTERVAL; another thread writes a copy of it."""

    def __init__(self, file: Autosave, about: About):
        self.file, self.about = file, about
        self.last, self.time = time.perf_counter(), 0.0
        self.writing: Future | None = None

    def observe(self, row: Row) -> None:
        lead, now = row.lead, time.perf_counter()
        busy = self.writing is not None and not self.writing.done()
        if busy or now - self.last < INTERVAL or lead.simulation.time == self.time:
            return
        self.last, self.time = now, lead.simulation.time
        about = replace(self.about, set=lead.changes())
        self.writing = self.file.write(about, lead.simulation.state())


@dataclass(frozen=True)
class LostSession:
    """A session that ended by a crash."""

    path: Path
    about: About

    @property
    def offer(self) -> str:
        about = self.about
        return (
            f"Enter continues {Path(about.scene).stem} of {about.began}, any other key deletes it"
        )

    @property
    def choice(self) -> Choice:
        about = self.about
        return Choice(about.scene, about.quality, about.set, resume=self.path)


def folder() -> Path:
    """Returns the folder of the files of all sessions."""
    return user_cache.file().parent


def lost_session(arguments: SceneArguments) -> LostSession | None:
    """Returns the last session that ended by a crash and can go on with these arguments."""
    for path in sorted(_left(), key=lambda p: p.stat().st_mtime, reverse=True):
        about = _about(path)
        if about and about.msph == VERSION:
            with contextlib.suppress(SceneError):
                full_name(about.scene)
                if about.overrides == arguments.overrides_of(about.scene):
                    return LostSession(path, about)
    return None


def forget() -> None:
    """Removes the files of all sessions that ended by a crash."""
    for path in _left():
        path.unlink(missing_ok=True)


def _left() -> list[Path]:
    """Returns the files of processes that have ended."""
    files = folder().glob(f"{PREFIX}*")
    return [path for path in files if not _in_use(path)]


def _in_use(path: Path) -> bool:
    """Returns True if the process that wrote a file still runs; a new process may reuse its id."""
    try:
        process = psutil.Process(int(path.name.split("_")[1]))
        return process.create_time() <= path.stat().st_mtime
    except (psutil.NoSuchProcess, ValueError, OSError):
        return False


def _about(path: Path) -> About | None:
    """Returns the description of a session, None if its file is damaged."""
    try:
        return TypeAdapter(About).validate_json(str(read_state(path)[SESSION]))
    except (ValueError, KeyError):
        return None
