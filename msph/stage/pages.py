"""Pages of text over the window's image: status, hints, messages, help."""

import functools
from typing import Any

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from msph.stage.keys import KEYS

# Text height over the window's height, and least legible height [pixels].
TEXT, LEAST_TEXT = 1.0 / 30.0, 12
# In text heights: padding, line pitch, width of the column of keys in the help.
PADDING, LINE, KEY_WIDTH = 0.5, 1.35, 10.0
# RGBA colours (0..255) of background, text, secondary text and warnings; the contrast is at least
# 7 on a dark image.
GROUND, INK, FAINT = (10, 20, 30, 176), (245, 247, 250, 255), (176, 206, 222, 255)
WARNING = (255, 209, 102, 255)
DENSE = (*GROUND[:3], 226)  # background of long pages
SOLID = (*GROUND[:3], 255)  # background of the help, which covers other pages


@functools.cache
def font_of(size: int):
    """Returns the font of a text height [pixels]; cached, since loading takes milliseconds."""
    return ImageFont.load_default(size=size)


def text_height(height: int) -> int:
    """Returns the text height for a window height [pixels]."""
    return max(LEAST_TEXT, round(TEXT * height))


def lines(texts: list[tuple[str, tuple]], size: int) -> np.ndarray:
    """Returns a page of lines with their colours, (height, width, 4) uint8, first row at the top;
    size: text height [pixels]."""
    font = font_of(size)
    pad, pitch = round(PADDING * size), LINE * size
    width = max(int(font.getlength(text)) for text, _ in texts) + 2 * pad
    page = Image.new("RGBA", (width, round(pitch * len(texts)) + pad), GROUND)
    draw = ImageDraw.Draw(page)
    for row, (text, colour) in enumerate(texts):
        y = 0.5 * pad + pitch * (row + 0.5)
        draw.text((pad, y), text, colour, font, anchor="lm")
    return np.asarray(page)


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


def hints(texts: list[str], urgent: bool, size: int, most: float) -> np.ndarray:
    """Returns a page with one line of hints, (height, width, 4) uint8: the first hint and as many
    more as fit into `most` pixels. Highlights the first if urgent; size: text height [pixels]."""
    font = font_of(size)
    pad, pitch, between = round(PADDING * size), LINE * size, 1.5 * size
    ends = np.cumsum([font.getlength(text) + between for text in texts]) + pad
    fit = max(1, int(np.sum(ends - between + pad <= most)))
    width = int(ends[fit - 1] - between) + pad
    page = Image.new("RGBA", (width, round(pitch) + pad), GROUND)
    draw = ImageDraw.Draw(page)
    for k, (x, text) in enumerate(zip([pad, *ends], texts[:fit], strict=False)):
        colour = WARNING if urgent and k == 0 else FAINT
        draw.text((x, 0.5 * (pad + pitch)), text, colour, font, anchor="lm")
    return np.asarray(page)


def help_page(size: int, most: int, taken: frozenset[str] = frozenset()) -> np.ndarray:
    """Returns the page of all keys not `taken` by a lesson. size: text height [pixels], reduced if
    the page would be higher than `most` [pixels]."""
    rows = [(key.label, key.effect) for key in KEYS if not taken & set(key.keys)]
    size = min(size, int(most / (LINE * (len(rows) + 1) + 2.0 * PADDING)))
    font = font_of(size)
    pad, pitch, column = round(2.0 * PADDING * size), LINE * size, KEY_WIDTH * size
    widest = max(font.getlength(effect) for _, effect in rows)
    width, height = int(column + widest) + 2 * pad, round(pitch * (len(rows) + 1)) + 2 * pad
    page = Image.new("RGBA", (width, height), SOLID)
    draw = ImageDraw.Draw(page)
    draw.text((pad, pad + 0.5 * pitch), "Keys and mouse (h closes)", WARNING, font, anchor="lm")
    for row, (label, effect) in enumerate(rows):
        y = pad + pitch * (row + 1.5)
        draw.text((pad, y), label, INK, font, anchor="lm")
        draw.text((pad + column, y), effect, FAINT, font, anchor="lm")
    return np.asarray(page)
