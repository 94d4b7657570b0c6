"""The recorder: pictures, video, meshes and checkpoints of a show, to files."""

import errno
import itertools
import os
import re
import sys
from pathlib import Path
from typing import Any

import imageio.v2 as imageio
import numpy as np
from tqdm import tqdm

from msph.errors import BadInputError
from msph.stage.controls import Controls
from msph.stage.show import Show

VIDEO = (".mp4", ".mov", ".mkv", ".webm")
MESH = (".ply", ".obj")
TABLE = (".npz", ".csv")
# Encoder's constant quality, 0 to 10: water has fine detail that lower ones smear.
VIDEO_QUALITY = 8
# The place for a frame number in a name.
NUMBER = re.compile(r"%0?[1-9]?d")
# The shortest time that a frame of a GIF can last is two hundredths of a second.
GIF_FPS = 50.0


class OutputError(BadInputError):
    """An output that cannot be written, in one line."""


class Recorder:
    """Writes `frames` frames at `fps` to each of `outputs`.

    An output is a video (.mp4, .mov, .mkv, .webm, .gif), a still (.png) of frame `still` or the
    last, or with a number such as %04d in its name one file per frame: pictures (.png), surface
    meshes (.ply, .obj), particles and checkpoints (.npz, .csv). The bar shows the time to go.
    """

    def __init__(
        self,
        outputs: list[Path],
        frames: int,
        fps: float,
        still: int | None = None,
        bar: bool = True,
    ):
        self.frames, self.fps = frames, fps
        self.still = frames if still is None else min(still, frames)
        self.done = 0
        self.last: Any = None  # the picture last recorded, (height, width, 3) uint8
        self.videos = [p for p in outputs if p.suffix in (*VIDEO, ".gif")]
        self.stills = [p for p in outputs if p.suffix == ".png" and not numbered(p)]
        self.sequences = [p for p in outputs if numbered(p)]
        self.writers: list = []
        self.bar = tqdm(
            total=frames, unit="frame", disable=not bar, file=sys.stderr, dynamic_ncols=True
        )

    def wants_more(self, show: Show) -> bool:
        return self.done < self.frames

    def controls(self, show: Show) -> Controls:
        return Controls()

    def see(self, show: Show) -> None:
        if show.picture:
            self.last = show.picture.to_numpy_u8()
            for path, writer in zip(self.videos, self.writers or self._open(), strict=True):
                writer.append_data(self._even() if path.suffix != ".gif" else self.last)
            if self.done + 1 == self.still:
                self._write_stills()
        for path in self.sequences:
            self._write_numbered(path, show)
        self.done += 1
        self.bar.update()

    def close(self) -> None:
        """Finishes every file, also after an interrupt: what was recorded can be played."""
        self.bar.close()
        for writer in self.writers:
            writer.close()
        if self.last is not None and self.done < self.still:
            self._write_stills()

    def _write_stills(self) -> None:
        for path in self.stills:
            imageio.imwrite(path, self.last)

    def _open(self) -> list:
        for path in self.videos:
            if path.suffix == ".gif":
                writer = imageio.get_writer(path, duration=self._gif_durations(), loop=0)
            else:
                writer = imageio.get_writer(
                    path, fps=self.fps, quality=VIDEO_QUALITY, macro_block_size=1
                )
            self.writers.append(writer)
        return self.writers

    def _even(self) -> np.ndarray:
        """The picture without its odd last row and column: encoders want even sizes."""
        height, width = self.last.shape[:2]
        return self.last[: height // 2 * 2, : width // 2 * 2]

    def _gif_durations(self) -> list[float]:
        """Milliseconds of every frame: hundredths of a second that add up to the true time."""
        ends = [round(100.0 * k / self.fps) for k in range(self.frames + 1)]
        return [10.0 * (b - a) for a, b in itertools.pairwise(ends)]

    def _write_numbered(self, path: Path, show: Show) -> None:
        target = path.with_name(NUMBER.sub(self._number, path.name))
        if path.suffix == ".png":
            imageio.imwrite(target, self.last)
        elif path.suffix in MESH:
            show.surface.mesh.export(target)
        elif path.suffix == ".npz":
            state: dict[str, Any] = show.simulation.state()
            np.savez_compressed(target, **state)
        else:
            write_csv(target, show)

    def _number(self, place: re.Match) -> str:
        return place[0] % self.done


def numbered(path: Path) -> bool:
    """Whether the name has a place for a frame number, such as %04d."""
    return NUMBER.search(path.name) is not None


def check_outputs(
    pictures: list[Path], meshes: list[Path], particles: list[Path], fps: float
) -> None:
    """Raises OutputError for what cannot be written, and makes the folders for the rest."""
    kinds = (pictures, (*VIDEO, ".gif", ".png")), (meshes, MESH), (particles, TABLE)
    for paths, suffixes in kinds:
        for path in paths:
            check_output(path, suffixes)
    paths = [*pictures, *meshes, *particles]
    if len(set(paths)) < len(paths):
        raise OutputError("the same output is named twice")
    if fps > GIF_FPS and any(p.suffix == ".gif" for p in paths):
        raise OutputError(f"a GIF has at most {GIF_FPS:g} frames per second")
    for path in paths:
        make_writable(path)


def make_writable(path: Path) -> None:
    """Makes the folder of a file to be written. Raises OutputError where that cannot be."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if not path.parent.is_dir() or not os.access(path.parent, os.W_OK):
            raise PermissionError(errno.EACCES, "permission denied")
    except OSError as error:
        problem = error.strerror or "cannot be written"
        raise OutputError(f"{path}: {problem[0].lower()}{problem[1:]}") from None


def check_output(path: Path, suffixes: tuple[str, ...]) -> None:
    """Raises OutputError for a name that is not one of these kinds of file."""
    if path.suffix not in suffixes:
        raise OutputError(f"{path}: unknown kind of file; known: {', '.join(suffixes)}")
    if len(NUMBER.findall(path.name)) > 1:
        raise OutputError(f"{path}: has more than one place for the frame number")
    if path.suffix in (*MESH, *TABLE) and not numbered(path):
        raise OutputError(f"{path}: needs a frame number in its name, such as %04d")
    if path.suffix in (*VIDEO, ".gif") and numbered(path):
        raise OutputError(f"{path}: a video is one file, leave out the frame number")


def write_csv(path: Path, show: Show) -> None:
    """Every carried attribute of every particle, a column each, named in the first line."""
    columns, names = [], []
    for name, attribute in show.simulation.particles.attributes.items():
        if attribute.carried:
            values = show.simulation.particles.numpy(name)
            columns.append(values.reshape(len(values), -1))
            parts = [f"{name}_{k}" for k in "xyz"] if attribute.width == 3 else [name]
            names += [f"{part} [{attribute.unit}]" for part in parts]
    np.savetxt(path, np.hstack(columns), delimiter=",", header=",".join(names), comments="")
