"""Part of a smoothing kernel's ball inside the walls of the box.

A plane at distance s cuts the part lambda(s/h) off the integral of poly6, lambda(t) = 1/2 - 315/256
(t - 4/3 t^3 + 6/5 t^5 - 4/7 t^7 + t^9/9), t = s/h in [0, 1], the integral of poly6's plane average
315/256 (1 - t^2)^4 from t to 1. The fluid fraction in a box is the product of (1 - lambda) over its
walls: exact for opposite and for distant walls.
"""

import numpy as np
import taichi as ti

# Coverage (-) at the surface before volume control: coverage on the plane boundary of deep water.
ISO = 0.5
SLOPE = 315.0 / 256.0
POLY6 = 315.0 / (64.0 * np.pi)


def missing(t: np.ndarray) -> np.ndarray:
    """Computes lambda(t), the part of poly6 beyond a plane at distance t h; t >= 0."""
    t = np.clip(t, 0.0, 1.0)
    return 0.5 - SLOPE * (t - 4 / 3 * t**3 + 6 / 5 * t**5 - 4 / 7 * t**7 + t**9 / 9)


@ti.func
def cut_share(t):
    """Computes lambda(t) in kernels."""
    t = ti.math.clamp(t, 0.0, 1.0)
    q = t * t
    inner = 1.0 + q * (-4.0 / 3.0 + q * (1.2 + q * (-4.0 / 7.0 + q / 9.0)))
    return 0.5 - SLOPE * t * inner


def fluid_fraction(x: np.ndarray, length: float, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """Computes the fluid fraction F between walls at 0 and `length`, and d(log F)/dx [1/m], at x
    [m]; reach [m] is the kernel's radius. Points outside are moved to the nearest wall."""
    x = np.clip(np.asarray(x, dtype=np.float64), 0.0, length)
    low, high = x / reach, (length - x) / reach
    left, right = 1.0 - missing(low), 1.0 - missing(high)
    # dlambda/dt = -315/256 (1 - t^2)^4, 0 for t > 1.
    rise, fall = (SLOPE * (1.0 - np.minimum(t, 1.0) ** 2) ** 4 for t in (low, high))
    slope = rise / left - fall / right
    return left * right, slope / reach
