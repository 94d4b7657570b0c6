"""How much of a smoothing kernel's ball lies in the water side of the box walls.

A plane at distance s cuts the part lambda(s/h) off the integral of poly6,
    lambda(t) = 1/2 - 315/256 (t - 4/3 t^3 + 6/5 t^5 - 4/7 t^7 + t^9/9),   t = s/h in [0, 1],
the integral of poly6's plane average 315/256 (1 - t^2)^4 from t to 1. The fluid fraction in a box
is taken as the product of (1 - lambda) over its walls, exact where walls are opposite or far.
"""

import numpy as np
import taichi as ti

# Coverage (-) at the surface before the volume is set right: that of a plane of deep water.
ISO = 0.5
SLOPE = 315.0 / 256.0
POLY6 = 315.0 / (64.0 * np.pi)


def missing(t: np.ndarray) -> np.ndarray:
    """lambda(t), the part of poly6 beyond a plane at distance t h; t >= 0."""
    t = np.clip(t, 0.0, 1.0)
    return 0.5 - SLOPE * (t - 4 / 3 * t**3 + 6 / 5 * t**5 - 4 / 7 * t**7 + t**9 / 9)


@ti.func
def share_behind(t):
    """missing(t) in kernels."""
    t = ti.math.clamp(t, 0.0, 1.0)
    q = t * t
    inner = 1.0 + q * (-4.0 / 3.0 + q * (1.2 + q * (-4.0 / 7.0 + q / 9.0)))
    return 0.5 - SLOPE * t * inner


def missing_slope(t: np.ndarray) -> np.ndarray:
    """dlambda/dt = -315/256 (1 - t^2)^4, zero beyond t = 1."""
    return -SLOPE * (1.0 - np.clip(t, 0.0, 1.0) ** 2) ** 4


def fluid_fraction(x: np.ndarray, length: float, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """Fluid fraction F between walls at 0 and `length`, and d(log F)/dx [1/m], at points x [m].

    reach [m] is the kernel's radius. Points outside are taken at the nearest wall.
    """
    x = np.clip(np.asarray(x, dtype=np.float64), 0.0, length)
    low, high = x / reach, (length - x) / reach
    left, right = 1.0 - missing(low), 1.0 - missing(high)
    slope = -missing_slope(low) / left + missing_slope(high) / right
    return left * right, slope / reach
