"""Legend of a particle view: a panel in the image that explains the colours."""

from dataclasses import dataclass

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from msph.picture import pixels
from msph.picture.overlay import Overlay
from msph.picture.particles_view import shown_colour

# Text height over image height; smallest text height [pixels] of any image, and of images at least
# READABLE_ROWS times as high as READABLE text.
TEXT, LEAST_TEXT, READABLE, READABLE_ROWS = 1.0 / 36.0, 12, 18, 18
# In text heights: gap around the panel, padding, size of the bar, line height, largest panel.
GAP, PADDING, BAR, LINE, MAX_PANEL = 0.8, 0.7, (11.0, 0.9), 1.35, (22.0, 28.0)
OVERSAMPLING = 4  # panels are reduced by this factor: small letters keep their shapes and spacing
PANEL, INK = (12, 20, 28, 150), (245, 247, 250, 255)  # RGBA of panel and text


@dataclass(frozen=True)
class Legend:
    """Meaning of the colours of a view.

    title: quantity and unit. marks: positions on the colour map (0..1) with their texts. With
    `bar`, numbers under a bar of all colours, without numbers that would touch an earlier one;
    otherwise a list of colour patches from top to bottom.
    """

    title: str
    marks: tuple[tuple[float, str], ...]
    bar: bool = True


def text_height(height: int) -> int:
    """Returns the text height [pixels] for an image of `height` rows."""
    return max(LEAST_TEXT, round(TEXT * height), min(READABLE, height // READABLE_ROWS))


def paint(legend: Legend, size: int) -> np.ndarray:
    """Returns the panel as pixels (height, width, 4) uint8, RGBA, top row first; size: of text
    [pixels]."""
    size *= OVERSAMPLING
    font = ImageFont.load_default(size=size)
    pad, line = round(PADDING * size), round(LINE * size)
    length, thick = (round(side * size) for side in BAR)
    patch = 2 * thick
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
        colours = (255 * shown_colour((np.arange(length) + 0.5) / length) + 0.5).astype(np.uint8)
        panel.paste(Image.fromarray(np.tile(colours, (thick, 1, 1))), (pad, top))
        placed: list[tuple[float, float]] = []  # centre and half width of the numbers
        for place, text in legend.marks:
            half = 0.5 * font.getlength(text)
            x = pad + min(max(place * length, half), length - half)
            if all(abs(x - y) > half + other + 0.5 * size for y, other in placed):
                draw.text((x, top + thick + 0.75 * size), text, INK, font, anchor="mm")
                placed.append((x, half))
    else:
        for row, (place, text) in enumerate(legend.marks):
            colour = (255 * shown_colour(place) + 0.5).astype(int)
            y = top + row * line
            draw.rectangle((pad, y, pad + patch - 1, y + thick - 1), (*colour.tolist(), 255))
            draw.text((2 * pad + patch, y + 0.5 * thick), text, INK, font, anchor="lm")
    return np.asarray(panel.reduce(OVERSAMPLING))


class LegendPanel:
    """Draws a legend in the lower right corner of images of up to width x height pixels."""

    def __init__(self, width: int, height: int):
        most = (int(m * text_height(height)) for m in MAX_PANEL)
        self.overlay = Overlay(width, height, {"legend": tuple(most)})  # type: ignore[dict-item]
        self.resize(width, height)

    def resize(self, width: int, height: int) -> None:
        """Adapts to images of another size."""
        self.size = text_height(height)
        self.gap = round(GAP * self.size)
        self.picture = width, height
        room = (n - 2 * self.gap for n in self.picture)
        most = (max(1, min(r, int(m * self.size))) for r, m in zip(room, MAX_PANEL, strict=True))
        self.overlay.resize(width, height, {"legend": tuple(most)})  # type: ignore[dict-item]
        self.legend: Legend | None = None

    def draw(self, legend: Legend, image: pixels.Image) -> None:
        if legend != self.legend:
            panel = paint(legend, self.size)
            height, width = panel.shape[:2]
            most = self.overlay.rooms["legend"]
            left = self.picture[0] - self.gap - min(most[0], width)
            top = self.picture[1] - self.gap - min(most[1], height)
            self.overlay.put("legend", panel, left, top)
            self.legend = legend
        self.overlay.draw(image)
