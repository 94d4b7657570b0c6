"""Kernel sums over particle positions on the host, for measurements outside of time steps.

Walls mirror the particles near them, so evenly spread water has the same density up to walls, edges
and corners. The kernel's integral over a wall would hide errors, as it assumes rest density.
"""

import math

import numpy as np


def wendland(r: np.ndarray, h: np.ndarray | float) -> np.ndarray:
    """Returns the Wendland C2 kernel [1/m^3] at distance r [m] for the support radius h [m]."""
    q = np.minimum(r / h, 1.0)
    return 21.0 / (2.0 * math.pi) / h**3 * (1.0 - q) ** 4 * (1.0 + 4.0 * q)


def epanechnikov(r: np.ndarray, h: np.ndarray | float) -> np.ndarray:
    """Returns the Epanechnikov kernel [1/m^3] at distance r [m] for the support radius h [m]: of
    all kernels it estimates a density with the least mean square error (Epanechnikov 1969)."""
    q = np.minimum(r / h, 1.0)
    return 15.0 / (8.0 * math.pi) / h**3 * (1.0 - q * q)


def quartic(r: np.ndarray, h: float) -> np.ndarray:
    """Returns the quartic B-spline M5 [1/m^3] at distance r [m] for the support radius h [m]."""
    q = r / h
    parts = ((1.0, 1.0), (-5.0, 0.6), (10.0, 0.2))
    shape = sum(factor * np.maximum(end - q, 0.0) ** 4 for factor, end in parts)
    return 15625.0 / (512.0 * math.pi) / h**3 * shape


def mirrored(
    x: np.ndarray, size: tuple[float, float, float], reach: float
) -> tuple[np.ndarray, np.ndarray]:
    """Returns the positions x (n, 3) [m] with their images behind walls nearer than `reach` [m],
    (m, 3), and the index into x of each, (m,)."""
    which = np.arange(len(x))
    for axis, length in enumerate(size):
        images, of = [x], [which]
        for wall in (0.0, length):
            close = np.abs(x[:, axis] - wall) < reach
            image = x[close]
            image[:, axis] = 2.0 * wall - image[:, axis]
            images.append(image)
            of.append(which[close])
        x, which = np.concatenate(images), np.concatenate(of)
    return x, which


def coverage(points: np.ndarray, x: np.ndarray, volume: np.ndarray, support: np.ndarray):
    """Returns the coverage c = sum V_j W(|p - x_j|, h_j) (-) of points p (n, 3) [m], (n,)."""
    r = np.linalg.norm(points[:, None] - x[None], axis=2)
    return (volume * wendland(r, support)).sum(axis=1)
