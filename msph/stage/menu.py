"""Menu: selection of live parameters, views, scenes and qualities by panel and keys."""

import time
from functools import partial

import numpy as np

from msph.options import AUTO
from msph.scene.errors import SceneError
from msph.scene.library import shipped_scenes
from msph.scene.live import read
from msph.scene.quality import at_quality
from msph.stage.choice import Choice, SceneArguments
from msph.stage.layout import Layout
from msph.stage.pacer import Pacer
from msph.stage.panel import Panel
from msph.stage.row import Row

# Time [s] without another selection before the selected scene is built.
SETTLED = 0.3


class Menu:
    """Selections of the user. next: the scene and quality to play next, None for no change."""

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
        self.panel = Panel(row.lead, choice.scene, choice.quality_now, layout.page)
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
            paint = partial(self.panel.paint, lead, layout.column_size, layout.text)
            layout.pages["settings"].show(self.panel.content(lead), paint, (0, layout.top))

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
            self.panel.page = self.layout.page = chosen
        elif kind == "reset":
            for live in self.panel.here():
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
