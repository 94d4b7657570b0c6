"""The panel of a window: sliders of the live parameters, and what else can be chosen."""

from dataclasses import dataclass
from typing import Any

from msph.scene.library import shipped_scenes
from msph.scene.live import Live, live_parameters, read
from msph.scene.quality import NAMES
from msph.stage.show import Show

# Groups that are open at first.
OPEN = ("settings",)
# Least change of a slider, over its range: less is its own rounding.
SAME = 1e-5


@dataclass(frozen=True)
class Wish:
    """What was chosen: of a kind ("set", "view", "scene", "quality"), which, and its value."""

    kind: str
    name: str
    value: float = 0.0


class Panel:
    """scene: what the show was asked for by, quality: what it is at."""

    def __init__(self, show: Show, scene: str, quality: str):
        self.live: list[Live] = live_parameters(show.scene)
        self.given = {live.key: read(show.scene, live.key) for live in self.live}
        self.scene, self.quality = scene, quality
        self.open = {name: name in OPEN for name in ("settings", "views", "scenes", "quality")}

    def draw(self, gui: Any, place: tuple[float, float, float, float], show: Show) -> list[Wish]:
        """Widgets within left, top, width, height (shares of the window); what they ask for."""
        wishes: list[Wish] = []
        with gui.sub_window("settings", *place):
            for name in self.open:
                self.open[name] = gui.checkbox(name, self.open[name])
                if self.open[name]:
                    wishes += getattr(self, f"_{name}")(gui, show)
        return wishes

    def value(self, show: Show, key: str) -> float:
        """Of a live parameter now."""
        return read(show.scene, key)

    def _settings(self, gui: Any, show: Show) -> list[Wish]:
        wishes = []
        for live in self.live:
            value = read(show.scene, live.key)
            unit = "" if live.unit == "-" else f" [{live.unit}]"
            name = live.key.rpartition(".")[2].replace("_", " ")
            # A label of its own, since that of a slider is cut off at the column's edge.
            gui.text(f"{name}{unit}")
            moved = gui.slider_float(f"##{live.key}", value, live.lo, live.hi)
            if abs(moved - value) > SAME * (live.hi - live.lo):
                wishes.append(Wish("set", live.key, moved))
        if gui.button("as the scene says"):
            wishes += [Wish("set", key, value) for key, value in self.given.items()]
        return wishes

    def _views(self, gui: Any, show: Show) -> list[Wish]:
        return self._choice(gui, "view", show.views.names, show.views.name)

    def _scenes(self, gui: Any, show: Show) -> list[Wish]:
        return self._choice(gui, "scene", tuple(shipped_scenes()), self.scene)

    def _quality(self, gui: Any, show: Show) -> list[Wish]:
        return self._choice(gui, "quality", NAMES, self.quality)

    @staticmethod
    def _choice(gui: Any, kind: str, names: tuple[str, ...], now: str) -> list[Wish]:
        """A button for each name, of which one is marked; the label tells kinds apart."""
        wishes = []
        for name in names:
            mark = "> " if name == now else "  "
            if gui.button(f"{mark}{name.replace('_', ' ')}##{kind}") and name != now:
                wishes.append(Wish(kind, name))
        return wishes
