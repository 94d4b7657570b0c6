"""Memory for images: classes of image sizes, and the fields that hold a value per pixel."""

from dataclasses import dataclass

import taichi as ti

# Pixels of the smallest class: the default window, with rows rounded up to a multiple of 64.
FIRST = 960, 544
COARSE = 8  # pixels from one sample of sky and ground to the next: clouds are hardly finer


@dataclass(frozen=True)
class PictureRoom:
    """A class of image sizes: rays through up to width x height pixels. Images of one class are
    drawn by the same compiled kernels."""

    width: int = FIRST[0]
    height: int = FIRST[1]

    @classmethod
    def holding(cls, width: int, height: int, rays: int = 1) -> "PictureRoom":
        """The smallest class for images of width x height pixels with rays x rays rays per pixel:
        the edges of the first class, each doubled until the image fits."""
        edges = zip((width * rays, height * rays), FIRST, strict=True)
        return cls(*(first << ((edge - 1) // first).bit_length() for edge, first in edges))

    def holds(self, width: int, height: int, rays: int = 1) -> bool:
        return width * rays <= self.width and height * rays <= self.height


SMALLEST = PictureRoom()  # the first class


class PixelFields:
    """All fields with a value per pixel, index [right, up], for images of one room; an image fills
    their lower left part. 64 bytes per pixel: 32 MiB in the first class.
    """

    def __init__(self, room: PictureRoom):
        self.room = room
        size = room.width, room.height
        self.canvas = ti.Vector.field(3, ti.f32, size)  # colour of each ray, display-referred
        self.wide = ti.Vector.field(3, ti.f32, size)  # the canvas enlarged along x
        self.resolved = ti.Vector.field(3, ti.f32, size)  # the canvas enlarged, or averaged
        self.key = ti.field(ti.i32, size)  # visibility buffer (see Rasteriser)
        self.back = ti.field(ti.i32, size)  # bits of the depth of the nearest back face [m]
        # The view without water: colour, display-referred, with the opacity of the rim before all.
        self.backdrop = ti.Vector.field(4, ti.f32, size)
        self.depth = ti.field(ti.f32, size)  # of bodies along the view [m], or FAR
        # Sky and ground at pixels (COARSE a, COARSE b), linear.
        self.country = ti.Vector.field(
            3, ti.f32, (room.width // COARSE + 2, room.height // COARSE + 2)
        )
