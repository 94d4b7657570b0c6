"""The recorder: pictures, video, meshes and checkpoints of a show, to files."""

import re
import sys
from pathlib import Path
from typing import Any

import imageio.v2 as imageio
import numpy as np
from tqdm import tqdm

from msph.stage.controls import Controls
from msph.stage.show import Show

VIDEO = (".mp4", ".mov", ".mkv", ".webm")
MESH = (".ply", ".obj")
TABLE = (".npz", ".csv")
# Encoder's constant quality, 0 to 10: water has fine detail that lower ones smear.
VIDEO_QUALITY = 8


class OutputError(ValueError):
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
        for path in outputs:
            check_output(path)
            path.parent.mkdir(parents=True, exist_ok=True)
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
            for writer in self.writers or self._open():
                writer.append_data(self.last)
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
                writer = imageio.get_writer(path, mode="I", duration=1000.0 / self.fps, loop=0)
            else:
                # Encoders want even sizes: two pixels are the smallest block.
                writer = imageio.get_writer(
                    path, fps=self.fps, quality=VIDEO_QUALITY, macro_block_size=2
                )
            self.writers.append(writer)
        return self.writers

    def _write_numbered(self, path: Path, show: Show) -> None:
        target = path.with_name(path.name % self.done)
        if path.suffix == ".png":
            imageio.imwrite(target, self.last)
        elif path.suffix in MESH:
            show.surface.mesh.export(target)
        elif path.suffix == ".npz":
            state: dict[str, Any] = show.simulation.state()
            np.savez_compressed(target, **state)
        else:
            write_csv(target, show)


def numbered(path: Path) -> bool:
    """Whether the name has a place for a frame number, such as %04d."""
    return re.search(r"%0?\d*d", path.name) is not None


def check_output(path: Path) -> None:
    """Raises OutputError for a file that the recorder does not know how to write."""
    known = (*VIDEO, ".gif", ".png", *MESH, *TABLE)
    if path.suffix not in known:
        raise OutputError(f"{path}: unknown kind of file; known: {', '.join(known)}")
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
