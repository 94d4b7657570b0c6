"""Start screen: the window's image until the first frame, with progress and keys."""

import numpy as np
from PIL import Image, ImageDraw

from msph.stage.sheet import LEAST_TEXT, font_of, text_height, wrapped

# Colours, 0..255: top and bottom of the background, text, secondary text.
SKY, DEEP = (24, 66, 92), (8, 24, 38)
INK, FAINT = (240, 246, 250), (150, 178, 194)
TITLE = 1.0 / 14.0  # title height over the window's height
# In shares of the window: left edge, top of title, progress and keys, width of the column of keys;
# line pitch in text heights.
LEFT, TOP, PROGRESS_TOP, KEYS_TOP = 0.08, 0.12, 0.36, 0.47
KEY_WIDTH, LINE = 0.24, 1.5
# Lines of progress above the keys; a list of many waiting keys is cut off.
PROGRESS_LINES = 2


class StartScreen:
    """Start screen of size (width, height) [pixels]; keys: pairs of keys and effect."""

    def __init__(self, size: tuple[int, int], title: str, keys: tuple[tuple[str, str], ...]):
        width, height = self.size = size
        text = text_height(height)
        self.font = font_of(text)
        slope = np.linspace(0.0, 1.0, height)[:, None, None]
        shades = (1.0 - slope) * np.array(SKY) + slope * np.array(DEEP)
        self.base = Image.fromarray(np.tile(shades.astype(np.uint8), (1, width, 1)))
        draw = ImageDraw.Draw(self.base)
        tall = max(LEAST_TEXT, round(TITLE * height))
        left, top = LEFT * width, TOP * height
        draw.text((left, top), "M-SPH", INK, font_of(tall))
        draw.text((left, top + 1.5 * tall), title, FAINT, self.font)
        for row, (key, meaning) in enumerate(keys):
            y = KEYS_TOP * height + LINE * text * row
            draw.text((left, y), key, INK, self.font)
            draw.text((left + KEY_WIDTH * width, y), meaning, FAINT, self.font)

    def paint(self, doing: str) -> np.ndarray:
        """Returns packed pixels (width, height) int32, index [right, up]; see
        msph/picture/pixels.py."""
        page = self.base.copy()
        left, top = LEFT * self.size[0], PROGRESS_TOP * self.size[1]
        lines = wrapped(doing, self.font, self.size[0] - 2.0 * left)[:PROGRESS_LINES]
        ImageDraw.Draw(page).text((left, top), "\n".join(lines), INK, self.font)
        words = np.asarray(page.convert("RGBA")).view("<i4")[..., 0]
        return np.ascontiguousarray(words[::-1].T)
