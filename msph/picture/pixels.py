"""Pictures out of Taichi."""

import numpy as np
import taichi as ti

# Opacity of a packed pixel, its highest byte.
OPAQUE = -0x01000000


@ti.kernel
def pack(image: ti.template(), pixels: ti.types.ndarray(dtype=ti.i32, ndim=2)):
    """A 3-vec field (width, height), 0..1, as words (width, height), since not every device stores
    bytes: red, green, blue, opacity from the lowest byte on."""
    for i in range(image.shape[0]):
        for j in range(image.shape[1]):
            word = OPAQUE
            for k in ti.static(range(3)):
                byte = ti.cast(ti.math.clamp(255.0 * image[i, j][k] + 0.5, 0.0, 255.0), ti.i32)
                word |= byte << (8 * k)
            pixels[i, j] = word


def as_bytes(pixels: np.ndarray) -> np.ndarray:
    """Packed pixels (width, height) as (width, height, 4) uint8."""
    return pixels.astype("<i4", copy=False).view(np.uint8).reshape(*pixels.shape, 4)


def as_u8(image: ti.Field) -> np.ndarray:
    """The pixels (height, width, 3) uint8, first row at the top, of a 3-vec field (width, height),
    0..1, index [right, up]."""
    pixels = np.empty(image.shape, np.int32)
    pack(image, pixels)
    return np.ascontiguousarray(as_bytes(pixels)[..., :3].transpose(1, 0, 2)[::-1])
