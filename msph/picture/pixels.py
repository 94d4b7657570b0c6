"""Images in device memory, and their transfer to the host."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import taichi as ti

OPAQUE = -0x01000000  # opacity of a packed pixel, its highest byte
# Colours between passes are words, which take a third of the memory and of its bandwidth: red,
# green, blue from the lowest bit on, each of WORD_BITS bits, finer than the bytes of an image.
WORD_BITS = 10
TOP = (1 << WORD_BITS) - 1


@ti.func
def word(colour):
    """Returns the word of a display-referred colour."""
    level = ti.cast(ti.math.clamp(colour, 0.0, 1.0) * TOP + 0.5, ti.i32)
    return level[0] | (level[1] << WORD_BITS) | (level[2] << (2 * WORD_BITS))


@ti.func
def colour_of(found):
    """Returns the display-referred colour of a word."""
    level = ti.Vector([found, found >> WORD_BITS, found >> (2 * WORD_BITS)]) & TOP
    return level * (1.0 / TOP)


@ti.func
def green_of(found):
    """Returns the green part of the colour of a word."""
    return ((found >> WORD_BITS) & TOP) * (1.0 / TOP)


@ti.func
def bilinear(f: ti.template(), c):
    """Interpolates f bilinearly at c, in cells from the centre of cell (0, 0), 0..size - 1."""
    i, j = ti.cast(c.x, ti.i32), ti.cast(c.y, ti.i32)
    u, v = c.x - i, c.y - j
    low = f[i, j] + u * (f[i + 1, j] - f[i, j])
    high = f[i, j + 1] + u * (f[i + 1, j + 1] - f[i, j + 1])
    return low + v * (high - low)


def colours(words: np.ndarray) -> np.ndarray:
    """Returns the display-referred colours (..., 3) float32 of words (...)."""
    levels = np.stack([words >> (k * WORD_BITS) & TOP for k in range(3)], axis=-1)
    return levels.astype(np.float32) / TOP


def words(colours: np.ndarray) -> np.ndarray:
    """Returns the words (...) int32 of display-referred colours (..., 3)."""
    levels = (np.clip(colours, 0.0, 1.0) * TOP + 0.5).astype(np.int32)
    return sum(levels[..., k] << (k * WORD_BITS) for k in range(3))


@dataclass(frozen=True, eq=False)
class Image:
    """Lower left width x height pixels of a 3-vec f32 field of display-referred colours, 0..1, with
    index [right, up]."""

    field: Any
    width: int
    height: int

    def to_numpy(self) -> np.ndarray:
        """Returns (width, height, 3) float32."""
        return self.field.to_numpy()[: self.width, : self.height]


@ti.kernel
def pack(field: ti.template(), pixels: ti.types.ndarray(dtype=ti.i32, ndim=2)):
    """Writes an image's field as words (width, height) int32, since not every device stores bytes:
    red, green, blue, opacity from the lowest byte on."""
    for i, j in ti.ndrange(pixels.shape[0], pixels.shape[1]):
        word = OPAQUE
        for k in ti.static(range(3)):
            byte = ti.cast(ti.math.clamp(255.0 * field[i, j][k] + 0.5, 0.0, 255.0), ti.i32)
            word |= byte << (8 * k)
        pixels[i, j] = word


def as_bytes(pixels: np.ndarray) -> np.ndarray:
    """Returns packed pixels (width, height) as (width, height, 4) uint8."""
    return pixels.astype("<i4", copy=False).view(np.uint8).reshape(*pixels.shape, 4)


def packed(image: Image) -> np.ndarray:
    """Returns an image as words (width, height) int32, as pack() writes them."""
    pixels = np.empty((image.width, image.height), np.int32)
    pack(image.field, pixels)
    return pixels


def as_rows(pixels: np.ndarray) -> np.ndarray:
    """Returns packed pixels (width, height) as (height, width, 3) uint8, first row at the top."""
    return np.ascontiguousarray(as_bytes(pixels)[..., :3].transpose(1, 0, 2)[::-1])


def matted(on_black: np.ndarray, on_white: np.ndarray) -> np.ndarray:
    """Returns an image (height, width, 4) uint8 with its opacity, from its renderings (height,
    width, 3) on a black and on a white background: c = a own + (1 - a) background."""
    black, white = on_black.astype(float), on_white.astype(float)
    opacity = np.clip(1.0 - (white - black).mean(axis=-1, keepdims=True) / 255.0, 0.0, 1.0)
    own = np.minimum(black / np.maximum(opacity, 1.0 / 255.0), 255.0)
    return np.concatenate([own, 255.0 * opacity], axis=-1).round().astype(np.uint8)


def as_u8(image: Image) -> np.ndarray:
    """Returns an image as (height, width, 3) uint8, first row at the top."""
    return as_rows(packed(image))
