"""Menu: live parameters, views, scenes and qualities that are chosen by panel and keys."""

import time

from msph.options import AUTO
from msph.scene.errors import SceneError
from msph.scene.library import shipped_scenes
from msph.scene.live import live_parameters, read
from msph.scene.quality import at_quality
from msph.stage.called import Called, Choice
from msph.stage.layout import Layout
from msph.stage.pacer import Pacer
from msph.stage.panel import Panel, Wish
from msph.stage.row import Row

# Time without another choice [s] after which the scene chosen last is built: keys that follow each
# other move the selection.
SETTLED = 0.3


class Menu:
    """next: the scene or quality that is to follow, None for none."""

    def __init__(
        self, row: Row, choice: Choice, quality: str, layout: Layout, pacer: Pacer, called: Called
    ):
        self.row, self.choice, self.layout, self.pacer = row, choice, layout, pacer
        self.called = called
        # Of each simulation the live parameters as its scene says.
        self.given = [
            {live.key: read(each.scene, live.key) for live in live_parameters(each.scene)}
            for each in row.shows
        ]
        self.panel = Panel(row.lead, choice.scene, quality)
        self.next: Choice | None = None
        self.chosen = 0.0  # when [s]
        for key, value in choice.set.items():
            self.set(key, value)

    @property
    def settled(self) -> bool:
        """True once another scene or quality is chosen for good."""
        return self.next is not None and time.perf_counter() - self.chosen > SETTLED

    def lay(self) -> None:
        """Shows the panel where settings are open."""
        if self.layout.panel == "settings":
            size, text = self.layout.column_size, self.layout.text
            self.layout.lay_panel(self.panel.paint(self.row.lead, size, text))

    def touch(self, cursor, down: bool) -> None:
        """Acts on the left button over the panel."""
        if self.layout.panel == "settings":
            x, y = self.layout.on_column(cursor)
            for wish in self.panel.touch(x, y, down, self.row.lead):
                self.grant(wish)

    def grant(self, wish: Wish) -> None:
        if wish.kind == "set":
            self.set(wish.name, wish.value)
        elif wish.kind == "reset":
            for each, given in zip(self.row.shows, self.given, strict=True):
                if wish.name in given:
                    each.set(wish.name, given[wish.name])
            self._pace(wish.name, read(self.row.lead.scene, wish.name))
        elif wish.kind == "view":
            self.row.lead.views.name = wish.name
        elif wish.kind == "scene":
            self.leave(Choice(wish.name, self.choice.quality))
        elif wish.kind == "quality":
            lead, panel = self.row.lead, self.panel
            values = {live.key: panel.value(lead, live.key) for live in panel.live}
            changed = {key: v for key, v in values.items() if v != panel.given[key]}
            self.leave(Choice(self.choice.scene, wish.name, changed))

    def step(self, by: int) -> None:
        """Moves the selection among the shipped scenes."""
        names, last = list(shipped_scenes()), (self.next or self.choice).scene
        here = names.index(last) if last in names else -max(by, 0)
        self.leave(Choice(names[(here + by) % len(names)], self.choice.quality))

    def leave(self, choice: Choice) -> None:
        """Chooses another scene or quality, if it can be loaded."""
        try:
            for scene in self.called.scenes_of(choice.scene).values():
                if choice.quality != AUTO:
                    at_quality(scene, choice.quality, choice.scene)
        except SceneError as error:
            self.layout.say(str(error))
        else:
            self.next, self.chosen = choice, time.perf_counter()
            self.layout.say(f"next: {choice.scene}, quality {choice.quality}")

    def set(self, key: str, value: float) -> None:
        """Changes a live parameter of all simulations."""
        self.row.set(key, value)
        self._pace(key, value)

    def _pace(self, key: str, value: float) -> None:
        """Tells the pacer of its own parameters."""
        if key == "play.speed":
            self.pacer.ask(value)
        if key == "play.scale":
            self.pacer.finest = value
