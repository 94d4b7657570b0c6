"""The image of a window until its first frame: what is being done, and the keys."""

import numpy as np
from PIL import Image, ImageDraw, ImageFont

# Colours, 0..255: of the background from its top to its bottom, of text, and of lesser text.
SKY, DEEP = (24, 66, 92), (8, 24, 38)
INK, FAINT = (240, 246, 250), (150, 178, 194)
# Heights of text over the window's, and the least that can be read [pixels].
TITLE, TEXT, LEAST_TEXT = 1.0 / 14.0, 1.0 / 30.0, 12
# Places in shares of the window: left edge, top of title, of what is being done, of the keys; the
# width of the column of keys; lines per text height.
LEFT, TOP, DOING_TOP, KEYS_TOP = 0.08, 0.12, 0.36, 0.47
KEY_WIDTH, LINE = 0.24, 1.5


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

    def paint(self, doing: str) -> np.ndarray:
        """Packed pixels (width, height) int32, index [right, up], see msph/picture/pixels.py."""
        page = self.base.copy()
        place = LEFT * self.size[0], DOING_TOP * self.size[1]
        ImageDraw.Draw(page).text(place, doing, INK, self.font)
        words = np.asarray(page.convert("RGBA")).view("<i4")[..., 0]
        return np.ascontiguousarray(words[::-1].T)
