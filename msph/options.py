"""Command-line options as dataclasses, and the names of the qualities.

This module imports only fast modules, because the command line loads it before any command.
"""

from dataclasses import dataclass
from pathlib import Path

# Qualities from coarse to fine, see msph/scene/quality.py. AS_GIVEN is the resolution of the scene
# file, AUTO the finest quality that runs in real time.
QUALITIES = ("small", "medium", "large", "finest")
AS_GIVEN, AUTO = "large", "auto"
# Quality of a replay if none is given: the quality of the recording.
AS_RECORDED = ""


@dataclass(frozen=True)
class RunOptions:
    """Options of every run: overrides as KEY=VALUE, architecture, CPU threads, quality."""

    overrides: tuple[str, ...] = ()
    arch: str = "auto"
    threads: int | None = None
    quality: str = AS_GIVEN


@dataclass(frozen=True)
class PlayOptions:
    """Options of `play`: size (width, height) [pixels] of the window, largest number of frames,
    overrides of each further simulation side by side (one string each), files for the user's input
    to record and to replay."""

    size: tuple[int, int]
    frames: int | None = None
    beside: tuple[str, ...] = ()
    record_input: Path | None = None
    replay: Path | None = None
    force: bool = False


@dataclass(frozen=True)
class CaptureOptions:
    """Options of `capture`: output files, duration [s], frames per simulated second, size (width,
    height) [pixels]. still_time [s]: time of a still image, None for the last frame. smooth: True
    for several rays per pixel unless the scene sets their number. record_input, replay: as in
    PlayOptions."""

    fps: float
    size: tuple[int, int]
    seconds: float | None = None
    outputs: tuple[Path, ...] = ()
    meshes: tuple[Path, ...] = ()
    particles: tuple[Path, ...] = ()
    bodies: tuple[Path, ...] = ()
    droplets: tuple[Path, ...] = ()
    usd: tuple[Path, ...] = ()
    mesh_layer: bool = False
    resume: str | None = None
    force: bool = False
    still_time: float | None = None
    smooth: bool = True
    record_input: Path | None = None
    replay: Path | None = None

    @property
    def data(self) -> tuple[Path, ...]:
        """Files of surfaces, particles and bodies."""
        return *self.meshes, *self.particles, *self.bodies, *self.droplets, *self.usd


@dataclass(frozen=True)
class BenchOptions:
    """Options of `bench`: duration [s], parts to time, size (width, height) [pixels], files."""

    seconds: float | None = None
    no_render: bool = False
    as_played: bool = False
    size: tuple[int, int] | None = None
    profile: bool = False
    json_file: Path | None = None
    replay: Path | None = None
    force: bool = False


@dataclass(frozen=True)
class MeasureOptions:
    """Options of `measure`: output folder, duration [s], time between two rows [s], number of
    spacings of a convergence study, checkpoint to continue from, recorded input to replay."""

    folder: Path | None = None
    seconds: float | None = None
    every: float | None = None
    converge: int | None = None
    resume: str | None = None
    replay: Path | None = None
    force: bool = False
