"""Sheet: what a page of the window is painted on, with texts, sliders and buttons.

GGUI's own widgets are 13 pixels high at any window size, in a panel that moves when dragged.
"""

import functools
from dataclasses import dataclass
from typing import Any

import numpy as np
from PIL import Image, ImageDraw, ImageFont

# Text height over the window's height, and least legible height [pixels].
TEXT, LEAST_TEXT = 1.0 / 30.0, 12
# In text heights: padding of a page, line pitch, radius of a slider's knob, distance of its value,
# padding of a button; width of a slider's track [pixels].
PADDING, LINE, KNOB, AWAY, BUTTON_PADDING, STROKE = 0.5, 1.35, 0.38, 0.5, 0.35, 4
# RGBA colours (0..255) of background, text, secondary text and warnings; the contrast is at least
# 7 on a dark image.
GROUND, INK, FAINT = (10, 20, 30, 176), (245, 247, 250, 255), (176, 206, 222, 255)
WARNING = (255, 209, 102, 255)
DENSE = (*GROUND[:3], 226)  # background of long pages
SOLID = (*GROUND[:3], 255)  # background of pages that cover other pages
# Colours of a track, a button and the selected button.
TRACK, BUTTON, CHOSEN = (86, 112, 130, 255), (27, 51, 71, 255), (58, 92, 112, 255)


@functools.cache
def font_of(size: int):
    """Returns the font of a text height [pixels]; cached, since loading takes milliseconds."""
    return ImageFont.load_default(size=size)


def text_height(height: int) -> int:
    """Returns the text height for a window height [pixels]."""
    return max(LEAST_TEXT, round(TEXT * height))


def wrapped(text: str, font: Any, width: float) -> list[str]:
    """Returns the text in lines of at most `width` pixels; a longer word has a line of its own."""
    lines = [""]
    for word in text.split():
        longer = f"{lines[-1]} {word}".strip()
        if lines[-1] and font.getlength(longer) > width:
            lines.append(word)
        else:
            lines[-1] = longer
    return lines


@dataclass(frozen=True)
class Button:
    """Button with its rectangle [pixels from the sheet's corner]."""

    name: str
    left: float
    right: float
    top: float
    bottom: float

    def under(self, x: float, y: float) -> bool:
        return self.left <= x <= self.right and self.top <= y <= self.bottom


@dataclass(frozen=True)
class Slider(Button):
    """Slider for values from lo to hi: track from left to right, active from top to bottom."""

    lo: float
    hi: float

    def value(self, x: float) -> float:
        """Returns the value with the knob at x."""
        share = min(max((x - self.left) / (self.right - self.left), 0.0), 1.0)
        return self.lo + share * (self.hi - self.lo)

    def under(self, x: float, y: float) -> bool:
        """Returns True if a point is on the slider, including a knob at an end."""
        reach = 0.5 * (self.bottom - self.top)
        return self.left - reach <= x <= self.right + reach and self.top <= y <= self.bottom


class Sheet:
    """Image of size (width, height) [pixels] with a text height [pixels], and its widgets.

    Lines of text have a pitch of LINE text heights; a y is the upper edge of a line [pixels].
    """

    def __init__(self, size: tuple[float, float], text: int, ground: tuple = GROUND):
        self.size = round(size[0]), round(size[1])
        self.image = Image.new("RGBA", self.size, ground)
        self.draw = ImageDraw.Draw(self.image)
        self.text, self.font, self.pitch = text, font_of(text), LINE * text
        self.widgets: list[Button] = []

    @property
    def pixels(self) -> np.ndarray:
        """The image, (height, width, 4) uint8, first row at the top."""
        return np.asarray(self.image)

    def write(self, x: float, y: float, text: str, colour: tuple = INK, anchor: str = "l") -> None:
        """Writes a text in the line at y; anchor: "l" to begin, "r" to end at x."""
        self.draw.text((x, y + 0.5 * self.pitch), text, colour, self.font, anchor + "m")

    def write_wrapped(
        self, texts: list[str], x: float, y: float, colour: tuple, width: float
    ) -> float:
        """Writes texts in lines of at most `width` pixels, and returns the y below them."""
        for text in texts:
            for line in wrapped(text, self.font, width):
                self.write(x, y, line, colour)
                y += self.pitch
        return y

    def slider(
        self, name: str, value: float, span: tuple[float, float], x: tuple[float, float], y: float
    ) -> None:
        """Draws a slider for the values of `span`, from x[0] to x[1], in the line at y."""
        self.widgets.append(Slider(name, *x, y, y + self.pitch, *span))
        middle, r = y + 0.5 * self.pitch, KNOB * self.text
        self.draw.line((x[0], middle, x[1], middle), TRACK, STROKE)
        knob = x[0] + (value - span[0]) / (span[1] - span[0]) * (x[1] - x[0])
        self.draw.ellipse((knob - r, middle - r, knob + r, middle + r), WARNING)

    def button(self, name: str, label: str, x: tuple[float, float], y: float, chosen: bool) -> None:
        """Draws a button from x[0] to x[1] in the line at y."""
        self.widgets.append(Button(name, *x, y, y + self.pitch))
        edges = x[0], y + 1, x[1], y + self.pitch - 2
        self.draw.rectangle(edges, CHOSEN if chosen else BUTTON)
        self.write(x[0] + BUTTON_PADDING * self.text, y, label, INK if chosen else FAINT)
