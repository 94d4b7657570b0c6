"""Layout of the window: pages over the image, and the panel column at the left."""

import math
import time
from typing import Any

import numpy as np

from msph.picture.overlay import Overlay
from msph.stage import pages
from msph.stage.graphs import Graphs
from msph.stage.idle import Idle
from msph.stage.pacer import Pacer
from msph.stage.panel import PAGES
from msph.stage.row import Row, show_with_picked
from msph.stage.status import EVERY, Status
from msph.stage.window import ARROWS

MESSAGE_TIME = 4.0  # display time of a message [s]
# In text heights: width of the panel column, gaps, largest height of a page of lines. HINTS: share
# of the window's width for hints next to the legend of a particle view.
COLUMN, GAP, ROOM, HINTS = 16.0, 0.25, 8, 0.62
# Contents of the column, in the order in which a key switches them.
PANELS = ("", "settings", "graphs")


class Layout:
    """Pages of a window of size (width, height) [pixels]. panel: one of PANELS, "" for no column;
    it stays open over scenes, as does the page of settings. Call begin() before the first frame of
    each scene."""

    def __init__(self, size: tuple[int, int]):
        width, height = self.size = size
        self.text = pages.text_height(height)
        self.gap, self.column = round(GAP * self.text), round(COLUMN * self.text)
        small = ("status", "hints", "message", "particle")
        rooms = {name: (width, ROOM * self.text) for name in small}
        rooms["graphs"] = rooms["settings"] = self.column, height
        rooms["tools"] = rooms["help"] = size
        self.overlay = Overlay(width, height, rooms)
        self.panel, self.page = "", PAGES[0]
        self.begin("")

    def begin(self, quality: str) -> None:
        """Resets all pages for a scene at this quality."""
        # Height at the lower edge [pixels] and keys taken by a lesson.
        self.below, self.taken = 0, frozenset[str]()
        self.status, self.graphs = Status(quality), Graphs()
        self.message, self.until = "", 0.0
        self.described: tuple[int | None, float] = None, 0.0  # picked particle, and time [s]
        self.hinted: Any = None  # hints on the current page
        self.share = 1.0  # of the free width, for hints and messages
        self.overlay.shown.clear()

    @property
    def free(self) -> float:
        """Share of the window's width right of the column."""
        return 1.0 - self.column / self.size[0] if self.panel else 1.0

    @property
    def column_size(self) -> tuple[int, int]:
        """Width and height of the column [pixels]."""
        return self.column, self.size[1] - self._top()

    def on_column(self, cursor: np.ndarray) -> tuple[float, float]:
        """Converts a cursor from (right, up) in shares of the window to (right, down) in pixels
        from the column's upper left corner."""
        return cursor[0] * self.size[0], (1.0 - cursor[1]) * self.size[1] - self._top()

    def put_panel(self, page: np.ndarray | None) -> None:
        """Shows a page of settings in the column; None for no change."""
        if page is not None:
            self.overlay.put("settings", page, 0, self._top())

    def put_tools(self, page: np.ndarray) -> None:
        """Shows the toolbar in the upper right corner, above legends."""
        left = self.size[0] - self.gap - page.shape[1]
        self.overlay.put("tools", page, left, self.gap)

    def on_tools(self, cursor: np.ndarray) -> tuple[float, float]:
        """Converts a cursor from (right, up) in shares of the window to (right, down) in pixels
        from the toolbar's upper left corner; both are NaN without a toolbar."""
        if "tools" not in self.overlay.shown:
            return math.nan, math.nan
        left, low, _, height = self.overlay.shown["tools"]
        return cursor[0] * self.size[0] - left, low + height - cursor[1] * self.size[1]

    def is_on_page(self, cursor: np.ndarray) -> bool:
        """Returns True if a cursor, (right, up) in shares of the window, is on the column or the
        toolbar."""
        if self.panel and 0.0 <= cursor[0] <= 1.0 - self.free:
            return True
        x, y = self.on_tools(cursor)
        return x >= 0.0 and 0.0 <= y <= self.overlay.shown["tools"][3]

    def next_panel(self) -> None:
        self.panel = PANELS[(PANELS.index(self.panel) + 1) % len(PANELS)]
        self.overlay.hide("graphs")
        self.overlay.hide("settings")
        self.hinted = None
        if not self.idle:
            # The column would cover a message that was shown without it.
            self._put_message(self.message)

    def show_message(self, message: str) -> None:
        """Shows a message for MESSAGE_TIME."""
        self._put_message(message)
        self.until = time.perf_counter() + MESSAGE_TIME
        self.message = message

    @property
    def idle(self) -> bool:
        """True if no message is shown."""
        return time.perf_counter() > self.until

    def show_help(self, shown: bool) -> None:
        if not shown:
            self.overlay.hide("help")
            return
        width, height = self.size
        page = pages.help_page(self.text, height - 2 * self.gap, self.taken)
        left, top = (width - page.shape[1]) // 2, (height - page.shape[0]) // 2
        self.overlay.put("help", page, left, top)

    def draw(self, row: Row, pacer: Pacer, paused: bool, idle: Idle) -> None:
        """Draws all pages over the row's image; repaints only pages that have changed."""
        now = time.perf_counter()
        status = self.status.page(row, pacer, paused, bool(self.panel), now, self.text)
        if status is not None:
            self.overlay.put("status", status, self.gap, self.gap)
        self.share = 1.0 if row.lead.display.views.name == "water" else HINTS
        self._put_hints([k.hint for k in idle.hints()], bool(idle.hint()))
        if self.idle:
            self.overlay.hide("message")
        self._put_particle(row, now)
        if self.graphs.observe(row.lead, now, pacer.pace) and self.panel == "graphs":
            top = self._top()
            page = self.graphs.paint(row.lead, self.column, self.size[1] - top, self.text)
            self.overlay.put("graphs", page, 0, top)
        self.overlay.draw(row.image)

    def _put_hints(self, texts: list[str], urgent: bool) -> None:
        if (texts, urgent, self.share) == self.hinted:
            return
        self.hinted = texts, urgent, self.share
        self.overlay.hide("hints")
        if texts:
            page = pages.hints(texts, urgent, self.text, self._line_width())
            top = self.size[1] - self.gap - page.shape[0]
            self.overlay.put("hints", page, self._left(), top)

    def _put_particle(self, row: Row, now: float) -> None:
        """Shows the values of the picked particle and the legend of its arrows."""
        show = show_with_picked(row)
        if show is None or not show.display.views.neighbourhood.find():
            self.overlay.hide("particle")
            return
        picked = show.display.views.neighbourhood
        if picked.id == self.described[0] and now - self.described[1] < EVERY:
            return
        self.described = picked.id, now
        texts: list[tuple[str, tuple]] = [(line, pages.INK) for line in picked.facts()]
        for name, colour in zip(picked.arrows(np.zeros(3)), ARROWS, strict=False):
            texts.append((f"arrow: {name}", (*(int(255 * c) for c in colour), 255)))
        self.overlay.put("particle", pages.lines(texts, self.text), self._left(), self._top())

    def _put_message(self, text: str) -> None:
        """Shows a message above the line of hints."""
        room = self._line_width() - 2 * round(pages.PADDING * self.text)
        texts = pages.wrapped(text, pages.font_of(self.text), room)
        page = pages.lines([(line, pages.WARNING) for line in texts], self.text)
        hints = round((pages.LINE + pages.PADDING) * self.text)
        top = self.size[1] - self.below - 2 * self.gap - hints - page.shape[0]
        self.overlay.put("message", page, self._left(), top)

    def _line_width(self) -> float:
        """Returns the largest width of a line of hints or of a message [pixels]."""
        return self.share * self.free * self.size[0] - 2 * self.gap

    def _left(self) -> int:
        """Left edge of pages right of the column [pixels]."""
        return self.gap + (self.column if self.panel else 0)

    def _top(self) -> int:
        """Upper edge of the column [pixels]."""
        return 2 * self.gap + round(3.5 * pages.LINE * self.text)
