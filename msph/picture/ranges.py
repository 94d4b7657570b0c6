"""Ranges of colours with round ends, which do not flicker while the water moves."""

import math

# By what a smaller end must exceed the need before the range shrinks to it.
HEADROOM = 1.5


def nice(value: float) -> float:
    """The smallest of 1, 2 and 5 times powers of ten that is not below value > 0; 0 for others."""
    if value <= 0.0:
        return 0.0
    power = 10.0 ** math.floor(math.log10(value))
    # Rounding must not lift a value that is round already.
    return next(m * power for m in (1.0, 2.0, 5.0, 10.0) if value <= m * power * (1.0 + 1e-6))


class SteadyRange:
    """The range of one quantity from frame to frame, from 0 to a nice end or both ways.

    An end grows at once; it shrinks where HEADROOM times the need fits a smaller one, which is less
    than half of it. least: the smallest upper end, in the quantity's unit.
    """

    def __init__(self, least: float):
        self.least = least
        self.below = self.above = 0.0

    def cover(self, lo: float, hi: float) -> tuple[float, float]:
        """Ends (lo, hi) of a range that contains 0 and both values."""
        self.below, self.above = _follow(self.below, -lo), _follow(self.above, hi)
        above = max(self.above, self.least)
        # A short end is at least a tenth of the long one, so that both numbers are told apart.
        if not self.below:
            return 0.0, above
        return -max(self.below, above / 10.0), max(above, self.below / 10.0)


def _follow(end: float, need: float) -> float:
    """The end [>= 0] for what is needed now, given the last; the last where that is not finite."""
    if not math.isfinite(need):
        return end
    if need > end:
        return nice(need)
    return min(end, nice(HEADROOM * need))
