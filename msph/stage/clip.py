"""Clip: images of the last seconds, which become a video while the simulation goes on."""

import io
from collections import deque
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

import numpy as np
from PIL import Image as Picture

from msph.export.video import check_video, even, video_writer
from msph.own_files import writing
from msph.picture.pixels import Image, as_rows, packed

# Largest duration [s], frame rate, and memory [bytes], which may shorten the duration.
SPAN, FPS, MOST_BYTES = 10.0, 24.0, 256 << 20
# Quality of stored images (JPEG, 0 to 95), at which no blocks are visible in water.
QUALITY = 92


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
