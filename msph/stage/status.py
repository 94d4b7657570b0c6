"""Status lines of a window: speed, number of particles, errors."""

import math

import numpy as np

from msph.stage import pages
from msph.stage.pacer import Pacer
from msph.stage.row import Row
from msph.stage.show import Show

REAL_TIME = 0.95  # share of the requested speed that counts as reached
# Time [s] between two updates of the speed, and of counts and errors, which take milliseconds.
EVERY, WATER_EVERY = 0.4, 1.2


class Status:
    """Status page of a scene at a quality."""

    def __init__(self, quality: str):
        self.quality, self.last, self.counted = quality, -math.inf, -math.inf
        self.water = ""

    def page(
        self, row: Row, pacer: Pacer, paused: bool, now: float, size: int
    ) -> np.ndarray | None:
        """Returns the page at the wall-clock time `now` [s] with a text height of `size` [pixels],
        None if it is not due."""
        if now - self.last < EVERY:
            return None
        self.last = now
        speed, rate = pace(pacer.pace, pacer.speed, paused), 1.0 / pacer.wall
        first = f"time {row.lead.simulation.time:.1f} s   {speed}   {rate:.0f} frames/s"
        lines = [(first, pages.WARNING if "too slow" in speed else pages.INK)]
        # Simulations side by side have labels with these values.
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
        parts = [f"{sum(counts):,} particles in {layers}", f"quality {self.quality}"]
        if show.simulation.rim.mass > 0.0:
            parts.append(f"{show.simulation.rim.mass:.3g} kg spilt")
        if show.ledger.entries:
            parts.append(f"density error {100.0 * show.ledger.last_density_error():.2f} %")
        # Other views extract no surface.
        if show.views.name == "water" and not show.surface.mesh.overflowed():
            volume = show.surface.mesh.volume() / show.rest_volume() - 1.0
            parts.append(f"volume error {round(100.0 * volume, 1) + 0.0:+.1f} %")
        return ", ".join(parts)


def pace(rate: float, speed: float, paused: bool) -> str:
    """Describes the real-time factor `rate` (-) for the requested speed (-)."""
    factor = f"real-time factor {rate:.2f}"
    if paused:
        return f"{factor}, paused"
    if rate < REAL_TIME * speed:
        return f"{factor}: this machine is too slow"
    return f"{factor}, slow motion" if speed < 1.0 else factor
