"""Panels of pixels, such as text, drawn over an image."""

import numpy as np
import taichi as ti

from msph.launches import data_oriented, kernel
from msph.picture.pixels import Image


@data_oriented
class Overlay:
    """Panels over images of width x height pixels. rooms: by name, the largest size (width, height)
    of a panel [pixels]; larger panels are clipped at the right and at the bottom. `resize` reuses
    the memory allocated for the first rooms."""

    def __init__(self, width: int, height: int, rooms: dict[str, tuple[int, int]]):
        areas = [min(w, width) * min(h, height) for w, h in rooms.values()]
        self.pixels = ti.field(ti.u32, shape=max(1, sum(areas)))  # RGBA, from the lowest byte on
        self.resize(width, height, rooms)

    def resize(self, width: int, height: int, rooms: dict[str, tuple[int, int]]) -> None:
        """Hides all panels and adapts to another image size. Raises ValueError if memory is too
        small."""
        self.size = width, height
        self.rooms = {n: (min(w, width), min(h, height)) for n, (w, h) in rooms.items()}
        areas = [w * h for w, h in self.rooms.values()]
        if sum(areas) > self.pixels.shape[0]:
            raise ValueError(f"panels of {sum(areas)} pixels exceed {self.pixels.shape[0]}")
        self.offsets = dict(zip(self.rooms, np.cumsum([0, *areas[:-1]]).tolist(), strict=True))
        # Left, lower edge, width, height [pixels] of the visible panels.
        self.shown: dict[str, tuple[int, int, int, int]] = {}

    def put(self, name: str, page: np.ndarray, left: int, top: int) -> None:
        """Shows pixels (height, width, 4) uint8, top row first, at a distance from the left and the
        upper edge of the image [pixels]."""
        most = self.rooms[name]
        left, top = max(0, left), max(0, top)
        page = page[: min(most[1], self.size[1] - top), : min(most[0], self.size[0] - left)]
        height, width = page.shape[:2]
        flat = np.ascontiguousarray(page[::-1]).view(np.uint32).ravel()
        self._write(self.offsets[name], flat)
        self.shown[name] = left, self.size[1] - top - height, width, height

    def hide(self, name: str) -> None:
        self.shown.pop(name, None)

    def draw(self, image: Image) -> None:
        """Blends the visible panels over the image, in the order of rooms."""
        for name in self.rooms:
            if name in self.shown:
                self._blend(self.offsets[name], *self.shown[name], image.field)

    @kernel
    def _write(self, begin: ti.i32, values: ti.types.ndarray(dtype=ti.u32, ndim=1)):
        for k in range(values.shape[0]):
            self.pixels[begin + k] = values[k]

    @kernel
    def _blend(
        self,
        begin: ti.i32,
        left: ti.i32,
        low: ti.i32,
        width: ti.i32,
        height: ti.i32,
        image: ti.template(),
    ):
        for i, j in ti.ndrange(width, height):
            over = self.pixels[begin + j * width + i]
            colour = ti.Vector([ti.cast((over >> (8 * k)) & 255, ti.f32) / 255.0 for k in range(3)])
            opacity = ti.cast(over >> 24, ti.f32) / 255.0
            image[left + i, low + j] = ti.math.mix(image[left + i, low + j], colour, opacity)
