"""Colour ranges with round ends that are stable from frame to frame."""

import math

HEADROOM = 1.5  # a range shrinks to a smaller end that is at least this times the need


def nice(value: float) -> float:
    """Returns the smallest of 1, 2, 5 times powers of ten that is not below value > 0; else 0."""
    if value <= 0.0:
        return 0.0
    power = 10.0 ** math.floor(math.log10(value))
    # The tolerance keeps values that are round already.
    return next(m * power for m in (1.0, 2.0, 5.0, 10.0) if value <= m * power * (1.0 + 1e-6))


class SteadyRange:
    """Range of a quantity from frame to frame, with nice ends, that contains 0.

    An end grows at once, and shrinks to a smaller nice end that is at least HEADROOM times the
    need. least: smallest upper end, in the quantity's unit.
    """

    def __init__(self, least: float):
        self.least = least
        self.below = self.above = 0.0

    def cover(self, lo: float, hi: float) -> tuple[float, float]:
        """Returns the ends (lo, hi) of a range that contains 0 and both values."""
        self.below, self.above = _follow(self.below, -lo), _follow(self.above, hi)
        above = max(self.above, self.least)
        # A short end is at least a tenth of the long one, so that the two labels do not collide.
        if not self.below:
            return 0.0, above
        return -max(self.below, above / 10.0), max(above, self.below / 10.0)


def _follow(end: float, need: float) -> float:
    """Returns the end [>= 0] for the present need; the previous end if the need is not finite."""
    if not math.isfinite(need):
        return end
    if need > end:
        return nice(need)
    return min(end, nice(HEADROOM * need))
