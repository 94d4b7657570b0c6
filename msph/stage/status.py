"""Status of a window: speed and number of particles; next to an open panel also errors."""

import math

from msph.stage.pacer import Pacer
from msph.stage.row import Row
from msph.stage.sheet import FAINT, INK, WARNING
from msph.stage.show import Show

REAL_TIME = 0.95  # real-time factor from which a simulation runs in real time
# Time [s] between two measurements of the errors, which take milliseconds.
WATER_EVERY = 1.2


class Status:
    """Status of a scene at a quality: one line, and more lines next to an open panel."""

    def __init__(self, quality: str):
        self.quality, self.measured, self.water = quality, -math.inf, ""

    def texts(
        self, row: Row, pacer: Pacer, paused: bool, detailed: bool, now: float
    ) -> list[tuple[str, tuple]]:
        """Returns the lines with their colours at the wall-clock time `now` [s]. detailed: with
        time, frame rate, quality and errors."""
        first = pace(pacer, paused)
        # Simulations side by side have labels with these values.
        if not row.composed:
            counts = [n for n in row.lead.state.counts() if n]
            layers = f"{len(counts)} layer{'s' * (len(counts) > 1)}"
            first = f"{first}, {sum(counts):,} particles in {layers}"
            if row.lead.now.spilt > 0.0:
                first += f", {row.lead.now.spilt:.3g} kg spilt"
        lines = [(first, INK)]
        if detailed and pacer.frames:
            time = f"time {row.lead.now.time:.1f} s, {1.0 / pacer.wall:.0f} frames/s"
            lines.append((f"{time}, quality {self.quality}", FAINT))
            if not row.composed and now - self.measured > WATER_EVERY:
                self.measured, self.water = now, self._water(row.lead)
            if self.water:
                lines.append((self.water, FAINT))
        stopped = sorted(set().union(*(s.now.stopped for s in row.shows)))
        return lines + [(f"{name} stopped: no room", WARNING) for name in stopped]

    def _water(self, show: Show) -> str:
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
