"""Command-line options in bundles, and the names of the qualities.

Imports nothing slow: the command line needs these before any command is known.
"""

from dataclasses import dataclass
from pathlib import Path

# Qualities from coarse to fine, see msph/scene/quality.py. AS_GIVEN is the scene as it is written,
# AUTO the finest quality that runs in real time.
QUALITIES = ("small", "medium", "large", "finest")
AS_GIVEN, AUTO = "large", "auto"


@dataclass(frozen=True)
class RunOptions:
    """How a scene is run: overrides as KEY=VALUE, architecture, number of CPU threads, quality."""

    overrides: tuple[str, ...] = ()
    arch: str = "auto"
    threads: int | None = None
    quality: str = AS_GIVEN


@dataclass(frozen=True)
class PlayOptions:
    """size (width, height) [pixels] of the window; frames: their largest number; beside: overrides
    of each further simulation, as one text each."""

    size: tuple[int, int]
    frames: int | None = None
    beside: tuple[str, ...] = ()


@dataclass(frozen=True)
class CaptureOptions:
    """Files that are written, duration [s], frames per simulated second, size (width, height)
    [pixels]. still_time [s]: the frame of a still image, None for the last frame."""

    fps: float
    size: tuple[int, int]
    seconds: float | None = None
    outputs: tuple[Path, ...] = ()
    meshes: tuple[Path, ...] = ()
    particles: tuple[Path, ...] = ()
    resume: str | None = None
    force: bool = False
    still_time: float | None = None


@dataclass(frozen=True)
class BenchOptions:
    """Duration [s], what is timed, size (width, height) [pixels] of the image, output file."""

    seconds: float | None = None
    no_render: bool = False
    as_played: bool = False
    size: tuple[int, int] | None = None
    profile: bool = False
    json_file: Path | None = None
    force: bool = False


@dataclass(frozen=True)
class MeasureOptions:
    """Output folder, duration and time between two rows [s], number of spacings to compare, and
    checkpoint to go on from."""

    folder: Path | None = None
    seconds: float | None = None
    every: float | None = None
    converge: int | None = None
    resume: str | None = None
    force: bool = False
