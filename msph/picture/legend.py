"""The legend of a view of particles: a panel in the picture that says what the colours mean."""

from dataclasses import dataclass

import numpy as np
import taichi as ti
from PIL import Image, ImageDraw, ImageFont

from msph.picture.particles_view import shown_colour
from msph.taichi_internals import data_oriented, kernel

# Text height over the picture's, and the least that can be read [pixels].
TEXT, LEAST_TEXT = 1.0 / 36.0, 12
# Lengths in text heights: space round and in the panel, the bar, the pitch of lines, the most that
# a panel may measure.
GAP, PADDING, BAR, LINE, MOST = 0.8, 0.7, (11.0, 0.9), 1.35, (22.0, 28.0)
# Painted so many times as large and averaged: small letters keep their shapes and distances.
FINER = 4
# Colours of panel and text, with opacity, 0..255.
PANEL, INK = (12, 20, 28, 150), (245, 247, 250, 255)


@dataclass(frozen=True)
class Legend:
    """What the colours of a view mean.

    title: the quantity and its unit. marks: places on the colour map (0..1), each with its text:
    numbers under a bar of all colours, of which those are left out that would touch an earlier
    one; or where `bar` is false a patch of colour each, from top to bottom.
    """

    title: str
    marks: tuple[tuple[float, str], ...]
    bar: bool = True


def paint(legend: Legend, size: int) -> np.ndarray:
    """The panel as pixels (height, width, 4) uint8, RGBA, first row at the top.

    size: height of the text [pixels].
    """
    size *= FINER
    font = ImageFont.load_default(size=size)
    pad, line = round(PADDING * size), round(LINE * size)
    length, thick = (round(side * size) for side in BAR)
    patch = 2 * thick  # as wide as that
    widest = max(font.getlength(text) for _, text in legend.marks)
    inside = length if legend.bar else patch + pad + widest
    width = 2 * pad + int(max(inside, font.getlength(legend.title)))
    body = thick + line if legend.bar else line * (len(legend.marks) - 1) + thick
    panel = Image.new("RGBA", (width, 2 * pad + line + body), PANEL)
    draw = ImageDraw.Draw(panel)
    draw.text((pad, pad + 0.5 * size), legend.title, INK, font, anchor="lm")
    top = pad + line
    if legend.bar:
        length = width - 2 * pad
        panel.paste(_bar(length, thick), (pad, top))
        told: list[tuple[float, float]] = []  # middle and half width of the numbers
        for place, text in legend.marks:
            half = 0.5 * font.getlength(text)
            x = pad + min(max(place * length, half), length - half)
            if all(abs(x - y) > half + other + 0.5 * size for y, other in told):
                draw.text((x, top + thick + 0.75 * size), text, INK, font, anchor="mm")
                told.append((x, half))
    else:
        for row, (place, text) in enumerate(legend.marks):
            colour = (255 * shown_colour(place) + 0.5).astype(int)
            y = top + row * line
            draw.rectangle((pad, y, pad + patch - 1, y + thick - 1), (*colour.tolist(), 255))
            draw.text((2 * pad + patch, y + 0.5 * thick), text, INK, font, anchor="lm")
    return np.asarray(panel.reduce(FINER))


def _bar(length: int, thick: int) -> Image.Image:
    """Every colour of the map from left to right."""
    row = shown_colour((np.arange(length) + 0.5) / length)
    return Image.fromarray(np.tile((255 * row + 0.5).astype(np.uint8), (thick, 1, 1)))


@data_oriented
class LegendPanel:
    """Blends a legend into the lower left corner of pictures of width x height pixels."""

    def __init__(self, width: int, height: int):
        self.size = max(LEAST_TEXT, round(TEXT * height))
        self.gap = round(GAP * self.size)
        room = (n - 2 * self.gap for n in (width, height))
        self.most = tuple(
            max(1, min(r, int(m * self.size))) for r, m in zip(room, MOST, strict=True)
        )
        self.pixels = ti.Vector.field(4, ti.f32, self.most)  # 0..1, index [right, up]
        self.legend: Legend | None = None
        self.shape = (0, 0)  # (width, height) of the panel [pixels]

    def draw(self, legend: Legend, image) -> None:
        """Over the image, a 3-vec field (width, height), index [right, up]."""
        if legend != self.legend:
            self._set(legend)
        self._blend(*self.shape, self.gap, image)

    def _set(self, legend: Legend) -> None:
        """Renders the panel; what does not fit is cut off at the right and at the bottom."""
        width, height = self.most
        panel = paint(legend, self.size)[:height, :width]
        self.shape = panel.shape[1], panel.shape[0]
        padded = np.zeros((*self.most, 4), np.float32)
        padded[: self.shape[0], : self.shape[1]] = panel[::-1].transpose(1, 0, 2) / 255
        self.pixels.from_numpy(padded)
        self.legend = legend

    @kernel
    def _blend(self, width: ti.i32, height: ti.i32, gap: ti.i32, image: ti.template()):
        for i, j in ti.ndrange(width, height):
            over = self.pixels[i, j]
            image[gap + i, gap + j] = ti.math.mix(image[gap + i, gap + j], over.xyz, over.w)
