"""Videos: encoders by the suffix of the file, and a check that all frames were written."""

from pathlib import Path
from typing import Any

import imageio.v2 as imageio
import numpy as np

from msph.export.outputs import kind

# Encoder's constant quality, 0 to 10; lower values blur the fine detail of water.
VIDEO_QUALITY = 8
# WebM needs VP9, here at about the same quality and in real-time mode, since the default mode takes
# longer than the simulation.
WEBM: dict[str, Any] = {
    "codec": "libvpx-vp9",
    "quality": None,
    "output_params": ["-crf", "24", "-b:v", "0", "-deadline", "realtime", "-cpu-used", "5"],
}


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
