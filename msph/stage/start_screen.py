"""The picture of a window until its first frame: what is happening, how far it is, and the keys."""

import numpy as np
from PIL import Image, ImageDraw, ImageFont

# Colours, 0..255: of the background from its top to its bottom, of text, of lesser text, of the
# bar and of what it has still to fill.
SKY, DEEP = (24, 66, 92), (8, 24, 38)
INK, FAINT, BAR, TROUGH = (240, 246, 250), (150, 178, 194), (92, 190, 220), (36, 70, 90)
# Heights of text over the window's, and the least that can be read [pixels].
TITLE, TEXT, LEAST_TEXT = 1.0 / 14.0, 1.0 / 30.0, 12
# Places in shares of the window: left edge, top of title, of the bar, of the keys; the bar's width
# and height; the width of the column of keys; lines per text height.
LEFT, TOP, BAR_TOP, KEYS_TOP = 0.08, 0.12, 0.34, 0.47
BAR_WIDTH, BAR_HEIGHT, KEY_WIDTH, LINE = 0.84, 0.012, 0.24, 1.5


class StartScreen:
    """size (width, height) [pixels]; keys: pairs of a key and what it does."""

    def __init__(self, size: tuple[int, int], title: str, keys: tuple[tuple[str, str], ...]):
        width, height = self.size = size
        self.text = max(LEAST_TEXT, round(TEXT * height))
        self.font = ImageFont.load_default(size=self.text)
        slope = np.linspace(0.0, 1.0, height)[:, None, None]
        shades = (1.0 - slope) * np.array(SKY) + slope * np.array(DEEP)
        self.base = Image.fromarray(np.tile(shades.astype(np.uint8), (1, width, 1)))
        draw = ImageDraw.Draw(self.base)
        tall = max(LEAST_TEXT, round(TITLE * height))
        big = ImageFont.load_default(size=tall)
        left, top = LEFT * width, TOP * height
        draw.text((left, top), "M-SPH", INK, big)
        draw.text((left, top + 1.5 * tall), title, FAINT, self.font)
        for row, (key, meaning) in enumerate(keys):
            y = KEYS_TOP * height + LINE * self.text * row
            draw.text((left, y), key, INK, self.font)
            draw.text((left + KEY_WIDTH * width, y), meaning, FAINT, self.font)

    def paint(self, share: float, doing: str) -> np.ndarray:
        """Packed pixels (width, height) int32, index [right, up], see msph/picture/pixels.py; share
        (0 to 1) of the bar is full."""
        width, height = self.size
        page = self.base.copy()
        draw = ImageDraw.Draw(page)
        left, top = LEFT * width, BAR_TOP * height
        right, bottom = left + BAR_WIDTH * width, top + max(3.0, BAR_HEIGHT * height)
        draw.rectangle((left, top, right, bottom), TROUGH)
        draw.rectangle((left, top, left + min(share, 1.0) * (right - left), bottom), BAR)
        draw.text((left, bottom + 0.6 * self.text), doing, FAINT, self.font)
        words = np.asarray(page.convert("RGBA")).view("<i4")[..., 0]
        return np.ascontiguousarray(words[::-1].T)
