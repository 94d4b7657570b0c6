"""Layout of the window: pages over the image, and the panel column at the left."""

import math
import time
from functools import partial

import numpy as np

from msph.picture.overlay import Overlay
from msph.stage import pages
from msph.stage.graphs import Graphs
from msph.stage.idle import Idle
from msph.stage.pacer import Pacer
from msph.stage.page import Page
from msph.stage.row import Row, show_with_picked
from msph.stage.sheet import FAINT, INK, LINE, PADDING, WARNING, font_of, text_height, wrapped
from msph.stage.show import Show
from msph.stage.window import ARROWS

MESSAGE_TIME = 4.0  # display time of a message [s]
# Time [s] between two updates of numbers, and while the window waits for the simulation.
EVERY, WAITING_EVERY = 0.4, 0.1
# Time [s] between two measurements of the errors, which take milliseconds.
ERRORS_EVERY = 1.2
REAL_TIME = 0.95  # real-time factor from which a simulation runs in real time
# In text heights: width of the panel column, gaps, largest height of a page of lines. HINTS: share
# of the window's width for hints next to the legend of a particle view.
COLUMN, GAP, ROOM, HINTS = 16.0, 0.25, 8, 0.62
# Contents of the column, in the order in which a key switches them.
PANELS = ("", "settings", "graphs")
# Pages of the settings.
PAGES = ("water", "light", "play", "views", "scenes", "quality")


class Layout:
    """Pages of a window of size (width, height) [pixels]. panel: one of PANELS, "" for no column;
    it stays open over scenes, as does the open one of PAGES, `page`. Call begin() before the first
    frame of each scene."""

    def __init__(self, size: tuple[int, int]):
        width, height = self.size = size
        self.text = text_height(height)
        self.gap, self.column = round(GAP * self.text), round(COLUMN * self.text)
        # Upper edge of the column [pixels].
        self.top = 2 * self.gap + round(3.5 * LINE * self.text)
        small = ("status", "hints", "message", "particle")
        rooms = {name: (width, ROOM * self.text) for name in small}
        rooms["graphs"] = rooms["settings"] = self.column, height
        rooms["tools"] = rooms["help"] = size
        self.overlay = Overlay(width, height, rooms)
        self.pages = {name: Page(self.overlay, name) for name in rooms}
        self.panel, self.page = "", PAGES[0]
        self.begin("")

    def begin(self, quality: str) -> None:
        """Resets all pages for a scene at this quality."""
        # Height at the lower edge [pixels] and keys taken by a lesson.
        self.below, self.taken = 0, frozenset[str]()
        self.graphs, self.quality = Graphs(), quality
        self.measured, self.errors = -math.inf, ""  # time [s] of the errors, and the errors
        self.message, self.until = "", 0.0
        for page in self.pages.values():
            page.hide()

    @property
    def free(self) -> float:
        """Share of the window's width right of the column."""
        return 1.0 - self.column / self.size[0] if self.panel else 1.0

    @property
    def column_size(self) -> tuple[int, int]:
        """Width and height of the column [pixels]."""
        return self.column, self.size[1] - self.top

    def is_on_page(self, cursor: np.ndarray) -> bool:
        """Returns True if a cursor, (right, up) in shares of the window, is on the column or the
        toolbar."""
        on_column = bool(self.panel) and 0.0 <= cursor[0] <= 1.0 - self.free
        return on_column or self.pages["tools"].covers(cursor)

    def next_panel(self) -> None:
        self.panel = PANELS[(PANELS.index(self.panel) + 1) % len(PANELS)]
        self.pages["graphs"].hide()
        self.pages["settings"].hide()

    def show_message(self, message: str) -> None:
        """Shows a message for MESSAGE_TIME."""
        self.message, self.until = message, time.perf_counter() + MESSAGE_TIME

    @property
    def idle(self) -> bool:
        """True if no message is shown."""
        return time.perf_counter() > self.until

    def show_help(self, shown: bool) -> None:
        width, height = self.size
        paint = partial(pages.help_page, self.text, height - 2 * self.gap, self.taken)
        content, centre = self.taken if shown else None, (width / 2, height / 2)
        self.pages["help"].show(content, paint, centre, (0.5, 0.5))

    def draw(self, row: Row, pacer: Pacer, paused: bool, idle: Idle) -> None:
        """Draws all pages over the row's image."""
        now = time.perf_counter()
        self._show_status(row, pacer, paused, now)
        # Pages right of the column, and the largest width of a line of hints or of a message.
        left = self.gap + (self.column if self.panel else 0)
        share = 1.0 if row.lead.display.views.name == "water" else HINTS
        width = share * self.free * self.size[0] - 2 * self.gap
        self._show_hints([k.hint for k in idle.hints()], bool(idle.hint()), left, width)
        self._show_message(left, width)
        self._show_particle(row, left, now)
        self.graphs.observe(row.lead, now, pacer.pace)
        if self.panel == "graphs":
            paint = partial(self.graphs.paint, self.column_size, self.text)
            self.pages["graphs"].show(self.graphs.times[-1], paint, (0, self.top))
        self.overlay.draw(row.image)

    def _show_status(self, row: Row, pacer: Pacer, paused: bool, now: float) -> None:
        waiting = row.waiting
        content = now // (WAITING_EVERY if waiting else EVERY), bool(waiting), bool(self.panel)

        def paint():
            status = [(waiting, WARNING)] if waiting else self._status(row, pacer, paused, now)
            return pages.lines(status, self.text)

        self.pages["status"].show(content, paint, (self.gap, self.gap))

    def _status(self, row: Row, pacer: Pacer, paused: bool, now: float) -> list[tuple[str, tuple]]:
        """Returns lines with their colours: speed and number of particles; next to an open panel
        also time, frame rate, quality and errors."""
        first = pace(pacer, paused)
        # Simulations side by side have labels with these values.
        if not row.composed:
            counts = [n for n in row.lead.state.counts() if n]
            layers = f"{len(counts)} layer{'s' * (len(counts) > 1)}"
            first = f"{first}, {sum(counts):,} particles in {layers}"
            if row.lead.now.spilt > 0.0:
                first += f", {row.lead.now.spilt:.3g} kg spilt"
        lines = [(first, INK)]
        if self.panel and pacer.frames:
            time = f"time {row.lead.now.time:.1f} s, {1.0 / pacer.wall:.0f} frames/s"
            lines.append((f"{time}, quality {self.quality}", FAINT))
            if not row.composed and now - self.measured > ERRORS_EVERY:
                self.measured, self.errors = now, errors_of(row.lead)
            if self.errors:
                lines.append((self.errors, FAINT))
        stopped = sorted(set().union(*(s.now.stopped for s in row.shows)))
        return lines + [(f"{name} stopped: no room", WARNING) for name in stopped]

    def _show_hints(self, texts: list[str], urgent: bool, left: int, width: float) -> None:
        paint = partial(pages.hints, texts, urgent, self.text, width)
        at, content = (left, self.size[1] - self.gap), (tuple(texts), urgent, width)
        self.pages["hints"].show(content if texts else None, paint, at, (0.0, 1.0))

    def _show_message(self, left: int, width: float) -> None:
        """Shows the message above the line of hints."""

        def paint():
            room = width - 2 * round(PADDING * self.text)
            texts = wrapped(self.message, font_of(self.text), room)
            return pages.lines([(line, WARNING) for line in texts], self.text)

        hints = round((LINE + PADDING) * self.text)
        at = left, self.size[1] - self.below - 2 * self.gap - hints
        content = None if self.idle else (self.message, width)
        self.pages["message"].show(content, paint, at, (0.0, 1.0))

    def _show_particle(self, row: Row, left: int, now: float) -> None:
        """Shows the values of the picked particle and the legend of its arrows."""
        show = show_with_picked(row)
        if show is None or not show.display.views.neighbourhood.find():
            self.pages["particle"].hide()
            return
        picked = show.display.views.neighbourhood

        def paint():
            texts = [(line, INK) for line in picked.facts()]
            for name, colour in zip(picked.arrows(np.zeros(3)), ARROWS, strict=False):
                texts.append((f"arrow: {name}", (*(int(255 * c) for c in colour), 255)))
            return pages.lines(texts, self.text)

        self.pages["particle"].show((picked.id, now // EVERY), paint, (left, self.top))


def errors_of(show: Show) -> str:
    """Returns the errors of a simulation in words."""
    parts = []
    error = show.bulk_density_error()
    if math.isfinite(error):
        parts.append(f"bulk density error {round(100.0 * error, 2) + 0.0:+.2f} %")
    # Other views extract no surface.
    if show.display.views.name == "water" and not show.display.surface.mesh.overflowed():
        parts.append(f"volume error {round(100.0 * show.volume_error(), 1) + 0.0:+.1f} %")
    return ", ".join(parts)


def pace(pacer: Pacer, paused: bool) -> str:
    """Describes the speed of the simulation."""
    if paused:
        return "paused"
    # A lag is caught up at more than the requested speed.
    shown = pacer.speed if not pacer.frames else min(pacer.pace, pacer.speed)
    return "real time" if REAL_TIME <= shown <= 1.0 else f"{shown:.2f} times real time"
