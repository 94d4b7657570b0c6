"""Recorded input of a user: a text file with a scene and the input of each frame.

The file consists of JSON lines: a Header, then a RecordedFrame for each frame in which time passes
or the input changes. Places are in the box frame: a recording needs no window and no camera.
"""

import json
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Literal, TypeVar

import click
from pydantic import NonNegativeFloat, NonNegativeInt, TypeAdapter, ValidationError

from msph.constants import DEFAULT_SCENE, VERSION
from msph.errors import BadInputError, did_you_mean
from msph.options import RunOptions
from msph.scene.live import live_parameters
from msph.scene.schema import Scene
from msph.stage.choice import full_name
from msph.stage.controls import STRICT, Inputs
from msph.stage.tools import BY_NAME

T = TypeVar("T")


class RecordingError(BadInputError):
    """A file that is not a recording of input, or does not fit."""


@dataclass(frozen=True)
class Header:
    """First line of a recording: versions of the format and the program, the scene (name or file)
    at a quality, its overrides, and the overrides of further simulations side by side."""

    recording: Literal[1]
    msph: str
    scene: str
    quality: str
    overrides: tuple[str, ...] = ()
    beside: tuple[str, ...] = ()

    __pydantic_config__ = STRICT

    @classmethod
    def of(cls, scene: str, quality: str, *more: tuple[str, ...]) -> "Header":
        """Returns the header of a recording that starts now."""
        return cls(1, VERSION, full_name(scene), quality, *more)


@dataclass(frozen=True)
class RecordedFrame:
    """Input of a frame. frame: its number, from 0; time [s]: simulated time at its start."""

    frame: NonNegativeInt
    time: NonNegativeFloat
    input: Inputs = field(default_factory=Inputs)

    __pydantic_config__ = STRICT

    @property
    def duration(self) -> float:
        """Simulated time [s]."""
        given = self.input
        return 0.0 if given.still else given.until or given.frame_time or 0.0


HEADER, FRAME = TypeAdapter(Header), TypeAdapter(RecordedFrame)


@dataclass(frozen=True)
class Recording:
    """A header and at least one frame."""

    header: Header
    frames: list[RecordedFrame]

    @cached_property
    def duration(self) -> float:
        """Simulated time of all frames [s], resets included."""
        return sum(frame.duration for frame in self.frames)

    @property
    def moving(self) -> int:
        """Number of frames in which time passes."""
        return sum(frame.duration > 0.0 for frame in self.frames)

    def cut(self, seconds: float | None) -> "Recording":
        """Returns the frames that begin before `seconds` [s] of simulated time have passed."""
        frames, passed = [], 0.0
        for frame in self.frames:
            if seconds is not None and passed >= seconds:
                break
            frames.append(frame)
            passed += frame.duration
        return Recording(self.header, frames)

    def check(self, scene: Scene) -> None:
        """Raises RecordingError if a parameter is not live in the scene, or out of its range."""
        ranges = {live.key: (live.lo, live.hi) for live in live_parameters(scene)}
        for frame in self.frames:
            for key, value in frame.input.set.items():
                where = f"frame {frame.frame}: {key}"
                if key not in ranges:
                    raise RecordingError(f"{where}: {did_you_mean(key, ranges, 'live parameters')}")
                lo, hi = ranges[key]
                if value is not None and not lo <= value <= hi:
                    raise RecordingError(f"{where}: is {value:g}, must be {lo:g} to {hi:g}")


def line_of(part: Header | RecordedFrame) -> str:
    """Returns a line of a recording, without values that are defaults."""
    adapter: TypeAdapter = HEADER if isinstance(part, Header) else FRAME
    return json.dumps(adapter.dump_python(part, exclude_defaults=True)) + "\n"


def read(path: Path) -> Recording:
    """Returns the recording in a file. Raises RecordingError."""
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        problem = error.strerror if isinstance(error, OSError) else "is not a text file"
        raise RecordingError(f"{path}: {problem or 'cannot be read'}") from None
    if not lines:
        raise RecordingError(f"{path.name}: is empty")
    header = _parsed(HEADER, lines[0], f"{path.name}: line 1")
    frames, last = [], -1
    for number, line in enumerate(lines[1:], 2):
        where = f"{path.name}: line {number}"
        frame = _parsed(FRAME, line, where)
        given = frame.input
        if frame.frame <= last:
            raise RecordingError(f"{where}: frame {frame.frame} follows frame {last}")
        if not given.still and given.frame_time is None:
            raise RecordingError(f"{where}: input.frame_time: is missing")
        if given.use and given.use.tool not in BY_NAME:
            hint = did_you_mean(given.use.tool, BY_NAME, "tools")
            raise RecordingError(f"{where}: input.use.tool: {given.use.tool!r}; {hint}")
        frames.append(frame)
        last = frame.frame
    recording = Recording(header, frames)
    if not recording.moving:
        raise RecordingError(f"{path.name}: has no frames in which time passes")
    return recording


def _parsed(adapter: TypeAdapter[T], line: str, where: str) -> T:
    """Returns the object of a line. Raises RecordingError."""
    try:
        return adapter.validate_json(line)
    except ValidationError as error:
        first = error.errors()[0]
        if first["type"] == "json_invalid":
            raise RecordingError(f"{where}: is not JSON") from None
        key = ".".join(str(part) for part in first["loc"])
        problem = first["msg"][0].lower() + first["msg"][1:]
        raise RecordingError(": ".join(p for p in (where, key, problem) if p)) from None


def with_recording(
    scene: str | None, run: RunOptions, path: Path | None
) -> tuple[str, RunOptions, Recording | None]:
    """Returns the scene to run, its options, and the recording to replay, if `path` is given; the
    recording's overrides come first. Raises RecordingError, and UsageError if both a scene and a
    recording are given."""
    if path is None:
        return scene or DEFAULT_SCENE, run, None
    if scene:
        raise click.UsageError(f"SCENE and --replay exclude each other: {path} names its scene")
    recording = read(path)
    header = recording.header
    overrides = (*header.overrides, *run.overrides)
    run = replace(run, overrides=overrides, quality=run.quality or header.quality)
    return header.scene, run, recording
