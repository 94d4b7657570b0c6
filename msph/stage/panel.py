"""Settings panel: sliders of the live parameters, buttons for views, scenes and qualities."""

from msph.options import AUTO, QUALITIES
from msph.scene.library import shipped_scenes
from msph.scene.live import Live, live_parameters, read
from msph.stage.sheet import DENSE, FAINT, Sheet
from msph.stage.show import Show

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


class Panel:
    """Panel of a scene (name or file) at a quality. page: the open one of PAGES."""

    def __init__(self, show: Show, scene: str, quality: str, page: str = PAGES[0]):
        self.live: list[Live] = live_parameters(show.scene)
        self.scene, self.quality, self.page = scene, quality, page

    def content(self, show: Show) -> tuple:
        """Returns all that the open page shows."""
        values = tuple(read(show.scene, live.key) for live in self.here())
        return self.page, show.display.views.name, values

    def paint(self, show: Show, size: tuple[int, int], text: int) -> Sheet:
        """Returns the open page of size (width, height); text: text height, all in pixels."""
        sheet = Sheet(size, text, DENSE)
        pad, high = PAD * text, sheet.pitch
        inner = size[0] - 2 * pad
        for k, name in enumerate(PAGES):
            left = pad + (k % PER_ROW) * inner / PER_ROW
            span = left, left + inner / PER_ROW - 0.3 * pad
            y = pad + (k // PER_ROW) * high
            sheet.button(f"page {name}", name, span, y, name == self.page)
        y = pad + (len(PAGES) // PER_ROW + 0.5) * high
        draw = self._choices if self.page in ("views", "scenes", "quality") else self._sliders
        draw(sheet, show, (pad, size[0] - pad), y)
        return sheet

    def here(self) -> list[Live]:
        """Live parameters of the open page."""
        return [x for x in self.live if PAGE_OF.get(x.key.partition(".")[0], "water") == self.page]

    def _sliders(self, sheet: Sheet, show: Show, x: tuple[float, float], y: float) -> None:
        """Draws a line with name and value, and a slider, for each parameter."""
        for live in self.here():
            value = read(show.scene, live.key)
            unit = "" if live.unit == "-" else f" {live.unit}"
            sheet.write(x[0], y, live.label)
            sheet.write(x[1], y, f"{value:.3g}{unit}", FAINT, "r")
            ends = x[0] + 0.4 * sheet.text, x[1] - 0.4 * sheet.text
            sheet.slider(live.key, value, (live.lo, live.hi), ends, y + 0.9 * sheet.pitch)
            y += 2.1 * sheet.pitch
        sheet.button("reset", RESET, x, y + 0.2 * sheet.pitch, False)

    def _choices(self, sheet: Sheet, show: Show, x: tuple[float, float], y: float) -> None:
        """Draws a button for each choice and highlights the current one."""
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
            at = y + 1.15 * row * sheet.pitch
            sheet.button(f"{kind} {name}", name.replace("_", " "), span, at, name == now)
