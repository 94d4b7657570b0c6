"""Settings panel: sliders of the live parameters, buttons for views, scenes and qualities."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from PIL import Image, ImageDraw

from msph.options import AUTO, QUALITIES
from msph.scene.library import shipped_scenes
from msph.scene.live import Live, live_parameters, read
from msph.stage.pages import DENSE, FAINT, INK, LINE, font_of
from msph.stage.show import Show
from msph.stage.widgets import Grip, Sheet, Slider

# Pages of the panel.
PAGES = ("water", "light", "play", "views", "scenes", "quality")
# Number of choices beyond which buttons stand in two columns.
LONGEST_COLUMN = 12
# Pages of the live parameters by scene section; "water" for all others.
PAGE_OF = {"picture": "light", "play": "play"}
# Page buttons per row, and padding in text heights.
PER_ROW, PAD = 3, 0.5
# Label of the button that resets the page's parameters.
RESET = "reset to the scene's values"


@dataclass(frozen=True)
class Request:
    """A user request: kind ("set", "reset", "view", "scene", "quality"), name and value."""

    kind: str
    name: str
    value: float = 0.0


class Panel:
    """Panel of a scene (name or file) at a quality. page: the open one of PAGES."""

    def __init__(self, show: Show, scene: str, quality: str, page: str = PAGES[0]):
        self.live: list[Live] = live_parameters(show.scene)
        self.scene, self.quality, self.page = scene, quality, page
        self.sheet: Sheet | None = None
        self.grip = Grip()
        self.painted: Any = None

    def paint(self, show: Show, size: tuple[int, int], text: int) -> np.ndarray | None:
        """Returns the open page, (height, width, 4) uint8, first row at the top, None if unchanged;
        size (width, height) and text height [pixels]."""
        values = tuple(read(show.scene, live.key) for live in self._here())
        state = (self.page, show.display.views.name, values, size, text)
        if state == self.painted:
            return None
        self.painted = state
        page = Image.new("RGBA", size, DENSE)
        self.sheet = Sheet(ImageDraw.Draw(page), font_of(text), text)
        pad, high = PAD * text, LINE * text
        inner = size[0] - 2 * pad
        for k, name in enumerate(PAGES):
            left = pad + (k % PER_ROW) * inner / PER_ROW
            span = left, left + inner / PER_ROW - 0.3 * pad
            y = pad + (k // PER_ROW) * high
            self.sheet.button(f"page {name}", name, span, y, name == self.page)
        y = pad + (len(PAGES) // PER_ROW + 0.5) * high
        if self.page in ("views", "scenes", "quality"):
            self._choices(show, (pad, size[0] - pad), y)
        else:
            self._sliders(show, (pad, size[0] - pad), y)
        return np.asarray(page)

    def touch(self, x: float, y: float, down: bool, pressed: bool) -> list[Request]:
        """Returns the requests of the left button with the cursor at (x, y) [pixels from the page's
        corner]; see Grip.act."""
        acted = self.grip.act(self.sheet, x, y, down, pressed)
        if isinstance(acted, Slider):
            return [Request("set", acted.name, acted.value(x))]
        return self._click(acted.name) if acted else []

    def _click(self, button: str) -> list[Request]:
        kind, _, name = button.partition(" ")
        if kind == "page":
            self.page = name
            return []
        if kind == "reset":
            return [Request("reset", live.key) for live in self._here()]
        return [] if name in (self.scene, self.quality) else [Request(kind, name)]

    def _here(self) -> list[Live]:
        """Live parameters of the open page."""
        return [x for x in self.live if PAGE_OF.get(x.key.partition(".")[0], "water") == self.page]

    def _sliders(self, show: Show, x: tuple[float, float], y: float) -> None:
        """Draws a line with name and value, and a slider, for each parameter."""
        assert self.sheet is not None
        sheet, high = self.sheet, LINE * self.sheet.text
        for live in self._here():
            value = read(show.scene, live.key)
            unit = "" if live.unit == "-" else f" {live.unit}"
            sheet.draw.text((x[0], y + 0.5 * high), live.label, INK, sheet.font, anchor="lm")
            number = f"{value:.3g}{unit}"
            sheet.draw.text((x[1], y + 0.5 * high), number, FAINT, sheet.font, anchor="rm")
            ends = x[0] + 0.4 * sheet.text, x[1] - 0.4 * sheet.text
            sheet.slider(live.key, value, (live.lo, live.hi), ends, y + 0.9 * high)
            y += 2.1 * high
        sheet.button("reset", RESET, x, y + 0.2 * high, False)

    def _choices(self, show: Show, x: tuple[float, float], y: float) -> None:
        """Draws a button for each choice and highlights the current one."""
        assert self.sheet is not None
        kind, names, now = {
            "views": ("view", show.display.views.names, show.display.views.name),
            "scenes": ("scene", tuple(shipped_scenes()), self.scene),
            "quality": ("quality", (AUTO, *QUALITIES), self.quality),
        }[self.page]
        columns = 1 if len(names) <= LONGEST_COLUMN else 2
        width = (x[1] - x[0]) / columns
        for k, name in enumerate(names):
            row, column = divmod(k, columns)
            span = x[0] + column * width, x[0] + (column + 0.97) * width
            at = y + 1.15 * row * LINE * self.sheet.text
            self.sheet.button(f"{kind} {name}", name.replace("_", " "), span, at, name == now)
