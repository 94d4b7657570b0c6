"""Recorder: writes videos, images, meshes and particles of a show to files."""

import contextlib
import itertools
import math
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import imageio.v2 as imageio
import numpy as np
from PIL import Image

from msph.errors import LostOutputError
from msph.export import usd, vtu
from msph.export.files import (
    PARAVIEW,
    BodyFiles,
    write_droplets,
    write_mesh,
    write_particles,
)
from msph.export.outputs import (
    ANIMATION,
    BODIES,
    VIDEO,
    Outputs,
    kind,
    list_name,
    numbered,
    numbered_name,
)
from msph.export.video import check_video, even, video_writer
from msph.measure.body_table import BodyTable
from msph.own_files import writing, written
from msph.stage.controls import Controls
from msph.stage.loop import Audience
from msph.stage.progress import Progress
from msph.stage.row import Row
from msph.stage.show import Show

# Tolerance for the rounding of sums of frame times, over the time between two images.
ROUNDING = 1e-6
# Width over height of the camera's image in USD.
ASPECT = 16.0 / 9.0
# Quality of lossy WebP, 0 to 100: 75 shows no blocks in water.
WEBP_QUALITY = 75


class Recorder(Audience):
    """Writes `frames` frames at `fps` to the outputs, and frame `still` (default: the last) to the
    still images. first: number of the first frame in file names, after a checkpoint. aspect: width
    over height of the camera's image. sampled: frames of the simulation have other lengths, such as
    those of recorded input, and the first one after each multiple of 1 / fps is rendered and
    written. Raises LostOutputError if a file cannot be written completely."""

    def __init__(
        self,
        outputs: Outputs,
        frames: int,
        fps: float,
        still: int | None = None,
        bar: bool = True,
        first: int = 0,
        aspect: float = ASPECT,
        sampled: bool = False,
    ):
        self.frames, self.fps = frames, fps
        self.still = frames if still is None else min(still, frames)
        self.done, self.first, self.aspect = 0, first, aspect
        self.sampled, self.elapsed, self.seen = sampled, 0.0, 0  # elapsed: simulated time [s]
        self.outputs, self.lost = outputs, set[Path]()
        self.last: Any = None  # last recorded image, (height, width, 3 or 4) uint8
        self.videos = [p for p in outputs.pictures if kind(p) in VIDEO]
        self.animations = [p for p in outputs.pictures if kind(p) in ANIMATION]
        self.animation_frames: list[np.ndarray] = []
        self.stills = [p for p in outputs.pictures if kind(p) == ".png" and not numbered(p)]
        # Functions that write a frame, by outputs.
        self.written: tuple[tuple[list[Path], Callable[[Path, Show], None]], ...] = (
            (self.videos, self._add_image),
            ([p for p in outputs.pictures if numbered(p)], self._write_image),
            (outputs.meshes, partial(write_mesh, layer=outputs.mesh_layer)),
            (outputs.particles, write_particles),
            (outputs.droplets, write_droplets),
            ([p for p in outputs.bodies if kind(p) == PARAVIEW], self._write_bodies),
            ([*outputs.usd, *(p for p in outputs.bodies if kind(p) == BODIES)], self._add),
        )
        # Time [s] and file of each frame, by .vtu output.
        self.lists: dict[Path, list[tuple[float, Path]]] = {
            p: [] for p in outputs.all() if kind(p) == PARAVIEW
        }
        self.motions: Any = None  # BodyTable of the bodies
        self.films: dict[Path, Any] = {}  # files of all frames: videos, bodies, USD
        self.progress = Progress(frames, bar)

    def wants_more(self, row: Row) -> bool:
        row.receive()
        if self.outputs.data and not self.motions:
            self._begin(row.lead)
        return self.done < self.frames and not row.ended

    def controls(self, row: Row) -> Controls:
        return Controls(hidden=self.sampled)

    def _begin(self, show: Show) -> None:
        """Opens the files of all frames, and reads the forces on bodies from here on."""
        self.motions = BodyTable(show.simulation)
        self.motions.numbers(show.simulation.reached)
        for path in self.outputs.bodies:
            if kind(path) == BODIES:
                self.films[path] = BodyFiles(path, show)
        for path in self.outputs.usd:
            self.films[path] = usd.Film(path, self.fps, self.aspect, show, self.outputs.mesh_layer)

    def observe(self, row: Row) -> None:
        if not row.lead.new:
            return
        due = 1
        if self.sampled:
            self.elapsed += row.lead.simulated
            due = math.floor(self.elapsed * self.fps + ROUNDING) - self.seen
            self.seen += due
            if due:
                row.draw()
        for _ in range(due):
            self._write(row)

    def _write(self, row: Row) -> None:
        """Writes a frame to all outputs."""
        show = row.lead
        if show.size:
            alpha = show.scene.picture.alpha
            self.last = show.display.matted_image() if alpha else row.to_numpy_u8()
            if self.animations:
                self.animation_frames.append(self.last)
        if self.motions:
            self.numbers = self.motions.numbers(show.simulation.reached)
        for paths, write in self.written:
            for path in paths:
                with self._writing(path):
                    write(self._numbered(path), show)
        if self.done + 1 == self.still:
            self._write_stills()
        for path, files in self.lists.items():
            # The mesh is that of the end of the frame.
            sim = show.simulation
            time = sim.time if path in self.outputs.meshes else sim.reached
            files.append((time, self._numbered(path)))
        self.done += 1
        self.progress.update()

    def _add_image(self, path: Path, show: Show) -> None:
        if path not in self.films:
            self.films[path] = video_writer(path, self.fps, show.scene.picture.alpha)
        self.films[path].append_data(even(self.last))

    def _write_image(self, path: Path, show: Show) -> None:
        imageio.imwrite(path, self.last)

    def _write_bodies(self, path: Path, show: Show) -> None:
        vtu.write_bodies(path, show.simulation, self.numbers)

    def _add(self, path: Path, show: Show) -> None:
        self.films[path].add(self.first + self.done)

    def close(self) -> None:
        """Completes all files, also after an interrupt, and also if one of them fails."""
        self.progress.close()
        with contextlib.ExitStack() as ends:
            for path, files in self.lists.items() if self.done else ():
                ends.callback(vtu.write_list, list_name(path, self.first), files)
            if self.last is not None and self.done < self.still:
                ends.callback(self._write_stills)
            for path in self.animations if self.animation_frames else ():
                ends.callback(self._write_animation, path)
            for path in [*self.videos, *self.outputs.usd]:
                if path in self.films:
                    ends.callback(self._close_film, path)

    def _close_film(self, path: Path) -> None:
        with self._writing(path):
            self.films[path].close()
            if path in self.videos and path not in self.lost:
                check_video(path, self.done)

    def kept(self) -> list[Path]:
        """Returns the outputs that exist and are complete up to the last frame."""
        kept = [
            path
            for path in self.outputs.all()
            if path not in self.lost and (self.done if numbered(path) else written(path))
        ]
        return kept + [list_name(path, self.first) for path in self.lists if path in kept]

    @contextlib.contextmanager
    def _writing(self, path: Path) -> Iterator[None]:
        """Context like own_files.writing that also marks a failed output as lost."""
        try:
            with writing(self._numbered(path)):
                yield
        except LostOutputError:
            self.lost.add(path)
            raise

    def _write_stills(self) -> None:
        for path in self.stills:
            with self._writing(path):
                imageio.imwrite(path, self.last)

    def _write_animation(self, path: Path) -> None:
        """Writes the frames as a looping GIF or WebP; durations are multiples of 0.01 s or 1 ms,
        with the exact sum."""
        unit = 10 if kind(path) == ".gif" else 1  # [ms]
        ends = [round(1e3 / unit * k / self.fps) for k in range(len(self.animation_frames) + 1)]
        durations = [unit * (b - a) for a, b in itertools.pairwise(ends)]
        first, *others = (Image.fromarray(frame) for frame in self.animation_frames)
        more: dict[str, Any] = {"quality": WEBP_QUALITY} if kind(path) == ".webp" else {}
        with self._writing(path):
            first.save(
                path,
                save_all=True,
                append_images=others,
                # Pillow takes no list for a single frame.
                duration=durations if others else durations[0],
                loop=0,
                **more,
            )

    def _numbered(self, path: Path) -> Path:
        """Returns the file name of the current frame."""
        return numbered_name(path, self.first + self.done)
