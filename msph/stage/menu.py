"""Menu: selection of live parameters, views, scenes and qualities by settings panel and keys."""

import time
from functools import partial

import numpy as np

from msph.options import AUTO, QUALITIES
from msph.scene.errors import SceneError
from msph.scene.library import shipped_scenes
from msph.scene.live import Live, live_parameters, read
from msph.scene.quality import at_quality
from msph.stage.choice import Choice, SceneArguments
from msph.stage.layout import PAGES, Layout
from msph.stage.pacer import Pacer
from msph.stage.row import Row
from msph.stage.sheet import DENSE, FAINT, Sheet

# Time [s] without another selection before the selected scene is built.
SETTLED = 0.3
# Number of choices beyond which buttons stand in two columns.
LONGEST_COLUMN = 12
# Pages of the live parameters by scene section; "water" for all others.
PAGE_OF = {"picture": "light", "play": "play"}
# Page buttons per row, and padding in text heights.
PER_ROW, PAD = 3, 0.5
# Label of the button that resets the page's parameters.
RESET = "reset to the scene's values"


class Menu:
    """Selections of the user, and the settings panel, which shows the layout's open page. next: the
    scene and quality to play next, None for no change."""

    def __init__(
        self,
        row: Row,
        choice: Choice,
        layout: Layout,
        pacer: Pacer,
        arguments: SceneArguments,
    ):
        self.row, self.choice, self.layout, self.pacer = row, choice, layout, pacer
        self.arguments = arguments
        self.live: list[Live] = live_parameters(row.lead.scene)
        self.next: Choice | None = None
        self.chosen = 0.0  # time of the selection [s]
        for key, value in choice.set.items():
            self.set(key, value)

    @property
    def settled(self) -> bool:
        """True once another scene or quality is selected and SETTLED has passed."""
        return self.next is not None and time.perf_counter() - self.chosen > SETTLED

    def draw(self) -> None:
        """Draws the panel if the settings are open."""
        if self.layout.panel == "settings":
            layout, lead = self.layout, self.row.lead
            values = tuple(read(lead.scene, live.key) for live in self.here())
            content = layout.page, lead.display.views.name, values
            paint = partial(self.paint, layout.column_size, layout.text)
            layout.pages["settings"].show(content, paint, (0, layout.top))

    def paint(self, size: tuple[int, int], text: int) -> Sheet:
        """Returns the open page of size (width, height); text: text height, all in pixels."""
        sheet, page = Sheet(size, text, DENSE), self.layout.page
        pad, high = PAD * text, sheet.pitch
        inner = size[0] - 2 * pad
        for k, name in enumerate(PAGES):
            left = pad + (k % PER_ROW) * inner / PER_ROW
            span = left, left + inner / PER_ROW - 0.3 * pad
            y = pad + (k // PER_ROW) * high
            sheet.button(f"page {name}", name, span, y, name == page)
        y = pad + (len(PAGES) // PER_ROW + 0.5) * high
        draw = self._choices if page in ("views", "scenes", "quality") else self._sliders
        draw(sheet, (pad, size[0] - pad), y)
        return sheet

    def here(self) -> list[Live]:
        """Returns the live parameters of the open page."""
        page = self.layout.page
        return [x for x in self.live if PAGE_OF.get(x.key.partition(".")[0], "water") == page]

    def _sliders(self, sheet: Sheet, x: tuple[float, float], y: float) -> None:
        """Draws a line with name and value, and a slider, for each parameter."""
        for live in self.here():
            value = read(self.row.lead.scene, live.key)
            unit = "" if live.unit == "-" else f" {live.unit}"
            sheet.write(x[0], y, live.label)
            sheet.write(x[1], y, f"{value:.3g}{unit}", FAINT, "r")
            ends = x[0] + 0.4 * sheet.text, x[1] - 0.4 * sheet.text
            sheet.slider(live.key, value, (live.lo, live.hi), ends, y + 0.9 * sheet.pitch)
            y += 2.1 * sheet.pitch
        sheet.button("reset", RESET, x, y + 0.2 * sheet.pitch, False)

    def _choices(self, sheet: Sheet, x: tuple[float, float], y: float) -> None:
        """Draws a button for each choice and highlights the current one."""
        views, choice = self.row.lead.display.views, self.choice
        kind, names, now = {
            "views": ("view", views.names, views.name),
            "scenes": ("scene", tuple(shipped_scenes()), choice.scene),
            "quality": ("quality", (AUTO, *QUALITIES), choice.quality_now),
        }[self.layout.page]
        columns = 1 if len(names) <= LONGEST_COLUMN else 2
        width = (x[1] - x[0]) / columns
        for k, name in enumerate(names):
            row, column = divmod(k, columns)
            span = x[0] + column * width, x[0] + (column + 0.97) * width
            at = y + 1.15 * row * sheet.pitch
            sheet.button(f"{kind} {name}", name.replace("_", " "), span, at, name == now)

    def touch(self, cursor: np.ndarray, down: bool, pressed: bool) -> None:
        """Handles the left mouse button over the panel; see Page.act."""
        acted = self.layout.pages["settings"].act(cursor, down, pressed)
        if acted is None:
            return
        name, value = acted
        kind, _, chosen = name.partition(" ")
        if value is not None:
            self.set(name, value)
        elif kind == "page":
            self.layout.page = chosen
        elif kind == "reset":
            for live in self.here():
                self.set(live.key, None)
        elif kind == "view":
            self.row.lead.display.views.name = chosen
        elif kind == "scene" and chosen != self.choice.scene:
            self.select(Choice(chosen, self.choice.quality))
        elif kind == "quality" and chosen != self.choice.quality_now:
            self.select(Choice(self.choice.scene, chosen, self.row.lead.changes()))

    def step(self, by: int) -> None:
        """Moves the selection among the shipped scenes."""
        names, last = list(shipped_scenes()), (self.next or self.choice).scene
        here = names.index(last) if last in names else -max(by, 0)
        self.select(Choice(names[(here + by) % len(names)], self.choice.quality))

    def select(self, choice: Choice) -> None:
        """Selects another scene or quality, if it can be loaded."""
        try:
            for scene in self.arguments.scenes_of(choice.scene).values():
                if choice.quality != AUTO:
                    at_quality(scene, choice.quality, choice.scene)
        except SceneError as error:
            self.layout.show_message(str(error))
        else:
            self.next, self.chosen = choice, time.perf_counter()
            self.layout.show_message(f"next: {choice.scene}, quality {choice.quality}")

    def set(self, key: str, value: float | None) -> None:
        """Sets a live parameter of all simulations, None for its initial value; speed and image
        scale are also passed to the pacer."""
        self.row.set(key, value)
        value = read(self.row.lead.initial, key) if value is None else value
        if key == "play.speed":
            self.pacer.set_speed(value)
        if key == "play.scale":
            self.pacer.finest = value
