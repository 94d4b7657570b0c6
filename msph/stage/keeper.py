"""What a player takes from a row by a key, and how it is told in the window."""

import time
from collections.abc import Callable

from msph.errors import LostOutputError
from msph.scene.errors import SceneError
from msph.stage.keepsakes import Keepsakes
from msph.stage.layout import Layout
from msph.stage.replay import Replay
from msph.stage.row import Row
from msph.stage.window import REPORT_INTERVAL, Window

# Actions of keys that are its methods.
KEEPING = ("picture", "clip", "keep", "reopen")


class Keeper:
    """Keepsakes of what a window shows, and of its last seconds; each says what was done, or what
    went wrong."""

    def __init__(self, window: Window, layout: Layout, replay: Replay, keepsakes: Keepsakes):
        self.window, self.layout, self.replay, self.keepsakes = window, layout, replay, keepsakes
        self.told = 0.0  # when a clip was last told of [s]

    def picture(self, row: Row) -> None:
        self._say(lambda: self.keepsakes.picture(row))

    def clip(self, row: Row) -> None:
        if self.replay.frames:
            self._say(lambda: self.keepsakes.clip(row, self.replay, self._tell))

    def keep(self, row: Row) -> None:
        if self._alone(row):
            self._say(lambda: self.keepsakes.water(row.lead))

    def reopen(self, row: Row) -> None:
        if self._alone(row):
            self._say(lambda: self.keepsakes.reopen(row.lead))

    def _alone(self, row: Row) -> bool:
        """Whether there is one water; of several none is kept: they would part in time."""
        if len(row.shows) > 1:
            self.layout.show_message("one water alone can be kept and opened")
        return len(row.shows) == 1

    def _say(self, act: Callable[[], str]) -> None:
        try:
            self.layout.show_message(act())
        except (LostOutputError, SceneError, OSError) as error:
            self.layout.show_message(str(error))

    def _tell(self, share: float) -> None:
        """How much of a clip there is."""
        now = time.perf_counter()
        if now - self.told < REPORT_INTERVAL:
            return
        self.told = now
        self.layout.draw_message(f"clip: {100.0 * share:.0f} %", self.keepsakes.image)
        self.window.show(self.keepsakes.image)
