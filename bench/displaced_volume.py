"""Volume that a ball displaces in still water: what the sums of kernels with images make of it.

In water of rest density around a ball of radius R, c exceeds 1 by e(s) at the distance s from the
face, as images fill the kernel's share inside the ball inexactly. The solves then hold the water
there thinner by e; sums over pairs are symmetric, so the missing volume is the integral of e, and
the force on the ball is larger than the displaced weight by 3/R times the integral of
e(s) (1 + s/R)^2 over s. Sheets of particles at distances of one spacing take the place of the
integral where particles are arranged. Lengths are in spacings.

python bench/displaced_volume.py
"""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from msph.fluid.boundary.body_links import CONVEX, SMALL_SHARE
from msph.fluid.particles.kernels import QUARTIC

# Support radius, and points and weights of Gauss' rule on (0, 1).
SUPPORT = 2.45
NODES, WEIGHTS = np.polynomial.legendre.leggauss(200) * np.array([[0.5], [0.5]])
NODES = NODES + 0.5


def kernel(r: np.ndarray) -> np.ndarray:
    """Returns the quartic kernel W(r) [1/spacing^3]."""
    a, b, c = (np.maximum(edge - r / SUPPORT, 0.0) for edge in (1.0, 0.6, 0.2))
    return QUARTIC / SUPPORT**3 * (a**4 - 5.0 * b**4 + 10.0 * c**4)


def inside(s: np.ndarray, radius: float) -> np.ndarray:
    """Returns the kernel's shares inside a ball for points (n,) outside: a shell of radius q
    around a point at D from the centre has the fraction (R^2 - (D - q)^2)/(4 D q) inside."""
    q, d = s + NODES[:, None] * (SUPPORT - s), radius + s
    fraction = np.clip((radius**2 - (d - q) ** 2) / (4.0 * d * q), 0.0, 1.0)
    return (SUPPORT - s) * (WEIGHTS @ (4.0 * np.pi * q**2 * kernel(q) * fraction))


def ratio(s: np.ndarray, radius: float, convex: float) -> np.ndarray:
    """Returns the ratio a (-) that scales images in the ball (docs/method.md, "Bodies")."""
    plane = 1e6
    a = (inside(s, radius) + SMALL_SHARE) / (inside(s, plane) + SMALL_SHARE)
    return a * (1.0 + convex * np.maximum(1.0 - a, 0.0) ** 2)


def excess(s: float, radius: float, convex: float = CONVEX) -> float:
    """Returns c - 1 (-) at the distance s from a ball in water of rest density: the images, less
    the kernel's share inside the ball."""
    at = SUPPORT * NODES  # distances of the particles that have images
    d, there = radius + s, radius + at
    # The distances r of the particles on a sphere, r = |d - there| to d + there, at most SUPPORT.
    least, most = np.abs(d - there), np.minimum(d + there, SUPPORT)
    r = least + NODES[:, None] * np.maximum(most - least, 0.0)
    image = kernel(np.sqrt(r**2 + 4.0 * s * at))
    sphere = 2.0 * np.pi * there / d * (most - least).clip(0.0) * (WEIGHTS @ (r * image))
    factor = np.sqrt(ratio(at, radius, convex) * ratio(np.array([s]), radius, convex))
    return float(SUPPORT * WEIGHTS @ (sphere * factor) - inside(np.array([s]), radius)[0])


def force_error(radius: float, convex: float = CONVEX, first: float | None = None) -> float:
    """Returns the force on a ball over the displaced weight, less 1, in continuous water, or in
    sheets of particles from the distance `first` on."""
    s, weights = SUPPORT * NODES, SUPPORT * WEIGHTS
    if first is not None:
        s = first + np.arange(np.ceil(SUPPORT - first))
        weights = np.ones(len(s))
    e = np.array([excess(each, radius, convex) for each in s])
    return float(3.0 / radius * weights @ (e * (1.0 + s / radius) ** 2))


if __name__ == "__main__":
    for radius in (2.0, 3.0, 4.0, 6.0):
        for convex in (0.0, CONVEX):
            found = [force_error(radius, convex, first) for first in (None, 0.4, 0.5, 0.6)]
            print(
                f"{radius:g} spacings, {convex:g}:", *(f"{100.0 * each:+.2f} %" for each in found)
            )
