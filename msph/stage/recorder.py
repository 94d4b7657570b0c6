"""Recorder: writes videos, images, meshes and particles of a show to files."""

import contextlib
import itertools
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import imageio.v2 as imageio
import numpy as np
from PIL import Image

from msph.errors import LostOutputError
from msph.measure.body_table import BodyTable
from msph.measure.table import column
from msph.own_files import OutputError, place_of, writing, written
from msph.stage import vtu
from msph.stage.loop import Audience
from msph.stage.progress import Progress
from msph.stage.row import Row
from msph.stage.show import Show

VIDEO = (".mp4", ".mov", ".mkv", ".webm")
PARAVIEW = ".vtu"
MESH = (".ply", ".obj", PARAVIEW)
TABLE = (".npz", ".csv", PARAVIEW)
# Encoder's constant quality, 0 to 10; lower values blur the fine detail of water.
VIDEO_QUALITY = 8
# WebM needs VP9, here at about the same quality and in real-time mode, since the default mode takes
# longer than the simulation.
WEBM: dict[str, Any] = {
    "codec": "libvpx-vp9",
    "quality": None,
    "output_params": ["-crf", "24", "-b:v", "0", "-deadline", "realtime", "-cpu-used", "5"],
}
# Placeholder of the frame number in a file name.
NUMBER = re.compile(r"%0?[1-9]?d")
# Animated images, and the largest frame rate of a GIF, whose frames last at least 0.02 s.
ANIMATION = (".gif", ".webp")
GIF_FPS = 50.0
# Formats that may have an alpha channel.
ALPHA = (".png", ".webp", ".webm")
# Quality of lossy WebP, 0 to 100: 75 shows no blocks in water.
WEBP_QUALITY = 75


@dataclass(frozen=True)
class Outputs:
    """Files to record. pictures: video (.mp4, .mov, .mkv, .webm), animation (.gif, .webp), still
    image (.png), or one .png per frame with a number such as %04d in its name; meshes of the
    surface (.ply, .obj, .vtu), particles (.npz checkpoint, .csv, .vtu) and bodies (.vtu): with
    frame numbers."""

    pictures: list[Path] = field(default_factory=list)
    meshes: list[Path] = field(default_factory=list)
    particles: list[Path] = field(default_factory=list)
    bodies: list[Path] = field(default_factory=list)

    def all(self) -> list[Path]:
        return [*self.pictures, *self.meshes, *self.particles, *self.bodies]

    def names(self, first: int, frames: int) -> list[Path]:
        """Returns all files of a recording of `frames` frames, numbered from `first`."""
        found: list[Path] = []
        for path in self.all():
            numbers = range(first, first + frames) if numbered(path) else (first,)
            found += (numbered_name(path, number) for number in numbers)
            if kind(path) == PARAVIEW:
                found.append(list_name(path, first))
        return found


class Recorder(Audience):
    """Writes `frames` frames at `fps` to the outputs, and frame `still` (default: the last) to the
    still images. first: number of the first frame in file names, after a checkpoint. Raises
    LostOutputError if a file cannot be written completely."""

    def __init__(
        self,
        outputs: Outputs,
        frames: int,
        fps: float,
        still: int | None = None,
        bar: bool = True,
        first: int = 0,
    ):
        self.frames, self.fps = frames, fps
        self.still = frames if still is None else min(still, frames)
        self.done, self.first = 0, first
        self.outputs, self.lost = outputs, set[Path]()
        self.last: Any = None  # last recorded image, (height, width, 3 or 4) uint8
        self.videos = [p for p in outputs.pictures if kind(p) in VIDEO]
        self.animations = [p for p in outputs.pictures if kind(p) in ANIMATION]
        self.animation_frames: list[np.ndarray] = []
        self.stills = [p for p in outputs.pictures if kind(p) == ".png" and not numbered(p)]
        self.pictures = [p for p in outputs.pictures if numbered(p)]
        self.meshes, self.particles = outputs.meshes, outputs.particles
        # Time [s] and file of each frame, by .vtu output.
        self.lists: dict[Path, list[tuple[float, Path]]] = {
            p: [] for p in outputs.all() if kind(p) == PARAVIEW
        }
        self.motions: Any = None  # BodyTable of the bodies, if they are written
        self.writers: list = []
        self.progress = Progress(frames, bar)

    def wants_more(self, row: Row) -> bool:
        if self.outputs.bodies and not self.motions:
            self.motions = BodyTable(row.lead.simulation)
            self.motions.numbers(row.lead.simulation.reached)
        return self.done < self.frames

    def within(self, row: Row, share: float) -> None:
        self.progress.within(share, row.lead.pace)

    def observe(self, row: Row) -> None:
        if row.picture:
            alpha = row.lead.scene.picture.alpha
            self.last = row.lead.display.matted_image() if alpha else row.picture.to_numpy_u8()
            for path, writer in zip(self.videos, self.writers or self._open(alpha), strict=True):
                with self._writing(path):
                    writer.append_data(even(self.last))
            if self.animations:
                self.animation_frames.append(self.last)
            if self.done + 1 == self.still:
                self._write_stills()
        for path in self.pictures:
            with self._writing(path):
                imageio.imwrite(self._numbered(path), self.last)
        for path in self.meshes:
            with self._writing(path):
                write_mesh(self._numbered(path), row.lead)
        for path in self.particles:
            with self._writing(path):
                write_particles(self._numbered(path), row.lead)
        if self.outputs.bodies:
            numbers = self.motions.numbers(row.lead.simulation.reached)
            for path in self.outputs.bodies:
                with self._writing(path):
                    vtu.write_bodies(self._numbered(path), row.lead.simulation, numbers)
        sim = row.lead.simulation
        for path, files in self.lists.items():
            # The mesh is that of the end of the frame.
            time = sim.time if path in self.meshes else sim.reached
            files.append((time, self._numbered(path)))
        self.done += 1
        self.progress.update()

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
            for path, writer in zip(self.videos, self.writers, strict=False):
                ends.callback(self._close_video, path, writer)

    def _close_video(self, path: Path, writer: Any) -> None:
        with self._writing(path):
            writer.close()
            if path not in self.lost:
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

    def _open(self, alpha: bool) -> list:
        self.writers += [video_writer(path, self.fps, alpha) for path in self.videos]
        return self.writers

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


def video_writer(
    path: Path, fps: float, alpha: bool = False, quality: float = VIDEO_QUALITY
) -> Any:
    """Opens a video for append_data() of images of even sizes; alpha: with an alpha channel;
    quality: constant, 0 to 10, except for WebM."""
    options = WEBM if kind(path) == ".webm" else {"quality": quality}
    if alpha:
        options = {**options, "pixelformat": "yuva420p"}
    return imageio.get_writer(path, fps=fps, macro_block_size=1, **options)


def even(image: np.ndarray) -> np.ndarray:
    """Returns an image (height, width, channels) cropped to even sizes, as encoders require."""
    height, width = image.shape[:2]
    return image[: height // 2 * 2, : width // 2 * 2]


def check_video(path: Path, frames: int) -> None:
    """Raises OSError if a video has too few frames: encoders fail silently."""
    from imageio_ffmpeg import count_frames_and_secs

    try:
        # A relative name such as run:1.mp4 is taken for an address.
        found = count_frames_and_secs(str(path.absolute()))[0]
    except (RuntimeError, OSError, ValueError):
        found = 0
    if found < frames:
        raise OSError(f"the encoder wrote {found} of {frames} frames")


def kind(path: Path) -> str:
    """Returns the file's suffix in lower case, which selects the format."""
    return path.suffix.lower()


def numbered_name(path: Path, number: int) -> Path:
    """Returns the path with the frame number filled in, if it has a placeholder."""
    return path.with_name(NUMBER.sub(lambda place: place[0] % number, path.name))


def list_name(path: Path, first: int) -> Path:
    """Returns the .pvd file of the .vtu files `path`; first: number of the first frame."""
    stem = NUMBER.sub("", path.stem).rstrip("_-") or "frames"
    return path.with_name(stem + (f"_from_{first}" if first else "") + ".pvd")


def numbered(path: Path) -> bool:
    """Returns True if the name has a frame number such as %04d."""
    return NUMBER.search(path.name) is not None


def check_outputs(
    outputs: Outputs, fps: float, alpha: bool = False, has_bodies: bool = True
) -> None:
    """Raises OutputError for outputs of an unknown or unfit kind. alpha: the images have an alpha
    channel."""
    kinds = (
        (outputs.pictures, (*VIDEO, *ANIMATION, ".png")),
        (outputs.meshes, MESH),
        (outputs.particles, TABLE),
        (outputs.bodies, (PARAVIEW,)),
    )
    for paths, suffixes in kinds:
        for path in paths:
            check_output(path, suffixes)
    paths = outputs.all()
    if len({place_of(path) for path in paths}) < len(paths):
        raise OutputError("the same output is named twice")
    for path in outputs.pictures:
        if alpha and kind(path) not in ALPHA:
            known = ", ".join(ALPHA)
            raise OutputError(f"{path}: no alpha channel (picture.alpha); with one: {known}")
    if fps > GIF_FPS and any(kind(p) == ".gif" for p in paths):
        raise OutputError(f"a GIF has at most {GIF_FPS:g} frames per second")
    if any(kind(p) == PARAVIEW for p in paths) and not vtu.available():
        raise OutputError(".vtu files need meshio: pip install 'msph[paraview]'")
    if outputs.bodies and not has_bodies:
        raise OutputError(f"{outputs.bodies[0]}: the scene has no bodies")


def check_files(paths: list[Path], inputs: list[Path]) -> None:
    """Raises OutputError if a recording would write one of its files twice, or over an input."""
    read, seen = {place_of(path) for path in inputs}, set[Path]()
    for path in paths:
        place = place_of(path)
        if place in read:
            raise OutputError(f"{path}: is an input of this command; choose another name")
        if place in seen:
            raise OutputError(f"{path}: two outputs would write this file")
        seen.add(place)


def check_output(path: Path, suffixes: tuple[str, ...]) -> None:
    """Raises OutputError for a file name without one of these suffixes, or with a missing, extra or
    unexpected frame number."""
    if kind(path) not in suffixes:
        raise OutputError(f"{path}: unknown kind of file; known: {', '.join(suffixes)}")
    if len(NUMBER.findall(path.name)) > 1:
        raise OutputError(f"{path}: has more than one frame number")
    if kind(path) in (*MESH, *TABLE) and not numbered(path):
        raise OutputError(f"{path}: needs a frame number in its name, such as %04d")
    if kind(path) in (*VIDEO, *ANIMATION) and numbered(path):
        raise OutputError(f"{path}: a video is one file and needs no frame number")


def write_mesh(path: Path, show: Show) -> None:
    """Writes the surface mesh in the format of the suffix."""
    if kind(path) == PARAVIEW:
        vtu.write_surface(path, show.display.surface.mesh, show.simulation, show.display.whitewater)
    else:
        show.display.surface.mesh.export(path)


def write_particles(path: Path, show: Show) -> None:
    """Writes the particles in the format of the suffix."""
    if kind(path) == PARAVIEW:
        vtu.write_particles(path, show.simulation)
    elif kind(path) == ".npz":
        state: dict[str, Any] = show.simulation.state()
        np.savez_compressed(path, **state)
    else:
        write_csv(path, show)


def write_csv(path: Path, show: Show) -> None:
    """Writes all carried attributes of the particles as columns with a header."""
    columns, names = [], []
    for name, attribute in show.simulation.particles.attributes.items():
        if attribute.carried:
            values = show.simulation.particles.numpy(name)
            columns.append(values.reshape(len(values), -1))
            parts = [f"{name}_{k}" for k in "xyz"] if attribute.width == 3 else [name]
            names += [column(f"{part} [{attribute.unit}]") for part in parts]
    np.savetxt(path, np.hstack(columns), delimiter=",", header=",".join(names), comments="")
