"""The line at the top of a window: how fast time goes, how much water there is, how true it is."""

import math

import numpy as np

from msph.stage import pages
from msph.stage.pacer import Pacer
from msph.stage.row import Row
from msph.stage.show import Show

REAL_TIME = 0.95  # simulated over wall-clock time that passes for what was asked for
# Time [s] between two readings of the clock, and of the water: faster ones cannot be read, and to
# count and to measure takes milliseconds.
EVERY, WATER_EVERY = 0.4, 1.2


class Status:
    """quality: what the scene is at."""

    def __init__(self, quality: str):
        self.quality, self.last, self.counted = quality, -math.inf, -math.inf
        self.water = ""

    def page(
        self, row: Row, pacer: Pacer, paused: bool, now: float, size: int
    ) -> np.ndarray | None:
        """The page at the wall-clock time `now` [s], text `size` pixels high; None while that of
        before still holds."""
        if now - self.last < EVERY:
            return None
        self.last = now
        told = pace(pacer.pace, pacer.speed, paused)
        slow = "too slow" in told
        first = f"time {row.lead.simulation.time:.1f} s  {told}    {1.0 / pacer.wall:.0f} frames/s"
        lines = [(first, pages.WARNING if slow else pages.INK)]
        # A row says it of each.
        if not row.composed:
            if now - self.counted > WATER_EVERY:
                self.counted, self.water = now, self._water(row.lead)
            lines.append((self.water, pages.FAINT))
        lines += [
            (f"{name} stopped: no room", pages.WARNING)
            for name in sorted(set().union(*(s.stopped for s in row.shows)))
        ]
        return pages.lines(lines, size)

    def _water(self, show: Show) -> str:
        counts = [n for n in show.simulation.counts() if n]
        layers = f"{len(counts)} layer{'s' * (len(counts) > 1)}"
        told = [f"{sum(counts):,} particles in {layers}", f"quality {self.quality}"]
        if show.ledger.entries:
            told.append(f"density off by {100.0 * show.ledger.last_density_error():.2f} %")
        # Other views extract no surface.
        if show.views.name == "water" and not show.surface.mesh.overflowed():
            volume = show.surface.mesh.volume() / show.rest_volume() - 1.0
            told.append(f"volume by {round(100.0 * volume, 1) + 0.0:+.1f} %")
        return ", ".join(told)


def pace(rate: float, speed: float, paused: bool) -> str:
    """In words, how fast time goes: simulated over wall-clock time (-), and what was asked for."""
    if paused:
        return f"x{rate:.2f} paused"
    if rate < REAL_TIME * speed:
        return f"x{rate:.2f}: this machine is too slow for more"
    return f"x{rate:.2f}" + (" slow motion" if speed < 1.0 else "")
