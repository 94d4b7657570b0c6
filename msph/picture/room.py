"""Memory for images: classes of image sizes, and the fields with a value per pixel."""

import math
from dataclasses import dataclass

import taichi as ti

from msph.picture.samples import SPAN, SampleFields

FIRST = 960, 544  # smallest class [pixels]: the default window, rows rounded up to 64
COARSE = 8  # pixels between samples of sky and ground, which have little finer detail


@dataclass(frozen=True)
class PictureRoom:
    """Class of image sizes, up to width x height rays, that share compiled kernels."""

    width: int = FIRST[0]
    height: int = FIRST[1]

    @classmethod
    def holding(cls, width: int, height: int, rays: int = 1) -> "PictureRoom":
        """Returns the smallest class for images of width x height pixels with rays x rays rays per
        pixel: the edges of the first class times the least integers for which the image fits."""
        edges = zip((width * rays, height * rays), FIRST, strict=True)
        return cls(*(first * math.ceil(edge / first) for edge, first in edges))

    def holds(self, width: int, height: int, rays: int = 1) -> bool:
        return width * rays <= self.width and height * rays <= self.height


SMALLEST = PictureRoom()  # the first class


class PixelFields:
    """Fields with a value per pixel, index [right, up]; an image uses their lower left part. 61
    bytes per pixel: 30 MiB in the first class."""

    def __init__(self, room: PictureRoom):
        self.room, size = room, (room.width, room.height)
        self.canvas = ti.field(ti.i32, size)  # colour of each ray, a word of pixels.py
        self.high = ti.Vector.field(3, ti.f32, size)  # the image enlarged along y
        self.resolved = ti.Vector.field(
            3, ti.f32, size
        )  # the image: smoothed, enlarged or averaged
        self.key = ti.field(ti.i32, size)  # visibility buffer (see Rasteriser)
        self.back = ti.field(ti.i32, size)  # bits of the depth of the nearest back face [m]
        self.crossing = ti.field(ti.i32, size)  # first face behind `entry` (see Rasteriser)
        # Image without water: words of colours, and opacity of the edge lines in front.
        self.backdrop, self.lines = ti.field(ti.i32, size), ti.field(ti.f32, size)
        self.body = ti.field(ti.i32, size)  # depth and number of the visible body (see BodyFaces)
        # Depth at which the ray enters the container [m], or FAR; 0 if it begins there.
        self.entry = ti.field(ti.f32, size)
        # 1 for blocks of SPAN pixels whose colours are not drawn yet, since water hides them.
        self.postponed = ti.field(ti.i32, (room.width // SPAN + 1, room.height // SPAN + 1))
        # 1 for blocks that are uneven in the image without water.
        self.rough = ti.field(ti.i32, self.postponed.shape)
        self.samples = SampleFields(*size)
        # Sky and ground at pixels (COARSE a, COARSE b), linear.
        self.background = ti.Vector.field(
            3, ti.f32, (room.width // COARSE + 2, room.height // COARSE + 2)
        )
