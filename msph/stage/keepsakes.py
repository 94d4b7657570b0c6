"""Files saved by a key in the window: images, clips, and checkpoints that can be reopened."""

import io
import time
from collections import deque
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

import imageio.v2 as imageio
import numpy as np
from PIL import Image as Picture

from msph.errors import LostOutputError
from msph.export.video import check_video, even, video_writer
from msph.own_files import SCENE_SUFFIX, free_stem, replace, replacing, writing
from msph.picture.pixels import Image, as_rows, packed
from msph.scene.load import to_toml
from msph.scene.schema import Scene
from msph.stage.layout import Layout
from msph.stage.preparation import say
from msph.stage.row import Row

# Actions that a Saver implements.
SAVING = ("picture", "clip", "keep", "reopen")
# Simulations side by side, restored one by one, would no longer be in step.
SINGLE = "checkpoints need a single simulation"
# Of a clip: largest duration [s], frame rate, and memory [bytes], which may shorten the duration.
SPAN, FPS, MOST_BYTES = 10.0, 24.0, 256 << 20
# Quality of stored images (JPEG, 0 to 95), at which no blocks are visible in water.
QUALITY = 92


class Saver:
    """Saves files in a folder, named by scene and time, each with its current scene and quality
    next to it; shows a message for every file or error."""

    def __init__(self, layout: Layout, scene: str, quality: str):
        self.layout, self.clip = layout, Clip()
        self.folder, self.scene, self.quality = Path("out"), scene, quality
        self.clips: list[Future[Path]] = []

    def act(self, action: str, row: Row) -> None:
        """Carries out one of SAVING."""
        single = len(row.shows) == 1 or action in ("picture", "clip")
        try:
            message = getattr(self, f"_{action}")(row) if single else SINGLE
        except (LostOutputError, OSError) as error:
            message = str(error)
        if message:
            self.layout.show_message(message)

    def _picture(self, row: Row) -> str:
        """Saves the current image at full scale, with its legend, without the window's pages."""
        pictures, scale = [s.display.picture for s in row.shows], row.lead.display.picture.scale
        for picture in pictures:
            picture.scale = 1.0
        row.draw()
        pixels = row.to_numpy_u8()
        for picture in pictures:
            picture.scale = scale
        path = self._path(".png", row.lead.scene)
        with replacing(path) as new:
            # A higher level makes the window wait twice as long for 0.8 of the size.
            imageio.imwrite(new, pixels, compress_level=1)
        return f"{path}"

    def _clip(self, row: Row) -> str:
        """Begins to write a video of the last seconds."""
        if not self.clip.frames:
            return ""
        path = self._path(".mp4", row.lead.scene)
        self.clips.append(self.clip.write(path))
        return f"writing {path}"

    def report(self) -> None:
        """Shows a message for each clip that is complete or lost."""
        for clip in [c for c in self.clips if c.done()]:
            self.clips.remove(clip)
            self.layout.show_message(str(clip.exception() or clip.result()))

    def close(self) -> None:
        """Waits for all clips."""
        self.clip.close()
        for clip in self.clips:
            say(f"{clip.exception() or clip.result()}")
        self.clips.clear()

    def _keep(self, row: Row) -> str:
        """Saves a checkpoint."""
        row.lead.keep(self._path(".npz", row.lead.scene))
        return ""

    def _reopen(self, row: Row) -> str:
        """Loads the newest checkpoint of this scene and quality."""
        found = self.folder.glob(f"{self.scene}_*.npz")
        newest = sorted(found, key=lambda p: p.stat().st_mtime, reverse=True)
        nothing = f"no checkpoint of {self.scene} at quality {self.quality}; k saves one"
        row.lead.reopen(newest, nothing)
        return ""

    def _path(self, suffix: str, scene: Scene) -> Path:
        """Returns an unused file name, and writes the scene next to it."""
        self.folder.mkdir(parents=True, exist_ok=True)
        stem = free_stem(self.folder, f"{self.scene}_{time.strftime('%Y%m%d_%H%M%S')}")
        note = f"quality {self.quality}"
        replace(self.folder / f"{stem}{SCENE_SUFFIX}", to_toml(scene, note))
        return self.folder / f"{stem}{suffix}"


class Clip:
    """Compressed images of the last frames with their wall-clock times [s]. One thread compresses
    them, another one writes videos, so that images do not wait for a video."""

    def __init__(self) -> None:
        self.frames: deque[tuple[float, Future[bytes]]] = deque()
        self.compressor, self.writer = ThreadPoolExecutor(1), ThreadPoolExecutor(1)

    def observe(self, image: Image, now: float) -> None:
        """Stores an image at the wall-clock time `now` [s] if a frame is due."""
        if self.frames and now - self.frames[-1][0] < 1.0 / FPS:
            return
        self.frames.append((now, self.compressor.submit(compressed, packed(image))))
        while len(self.frames) > 1 and (now - self.frames[0][0] > SPAN or self.bytes > MOST_BYTES):
            self.frames.popleft()

    @property
    def bytes(self) -> int:
        """Memory of the compressed images."""
        return sum(len(image.result()) for _, image in self.frames if image.done())

    def write(self, path: Path) -> "Future[Path]":
        """Begins to write the stored images to a video; the result is its path, or a
        LostOutputError."""
        return self.writer.submit(_write, list(self.frames), path)

    def close(self) -> None:
        """Waits until all images and videos are written."""
        self.compressor.shutdown()
        self.writer.shutdown()


def compressed(pixels: np.ndarray) -> bytes:
    """Returns packed pixels (width, height) as a JPEG file."""
    file = io.BytesIO()
    Picture.fromarray(as_rows(pixels)).save(file, "JPEG", quality=QUALITY, subsampling=0)
    return file.getvalue()


def _write(frames: "list[tuple[float, Future[bytes]]]", path: Path) -> Path:
    """Writes a video of frames at constant rate: at each time the newest image, so that halts keep
    their length. Raises LostOutputError."""
    first, last = frames[0][0], frames[-1][0]
    number = max(1, round((last - first) * FPS))
    with writing(path), video_writer(path, FPS) as writer:
        k = 0
        for n in range(number):
            while k + 1 < len(frames) and frames[k + 1][0] <= first + (n + 0.5) / FPS:
                k += 1
            image = np.asarray(Picture.open(io.BytesIO(frames[k][1].result())))
            writer.append_data(even(image))
    with writing(path):
        check_video(path, number)
    return path
