"""Pictures out of Taichi."""

import numpy as np
import taichi as ti


def as_u8(image: ti.Field) -> np.ndarray:
    """The pixels (height, width, 3) uint8, first row at the top, of a 3-vec field (width, height),
    0..1, index [right, up]."""
    pixels = image.to_numpy().transpose(1, 0, 2)[::-1]
    return (255.0 * pixels + 0.5).clip(0, 255).astype(np.uint8)
