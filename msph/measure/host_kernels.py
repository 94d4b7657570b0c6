"""Kernel sums over particle positions on the host, for measures that no time step waits for.

Walls are mirrors here: particles within reach of a wall are counted again behind it. Water that
fills its box evenly then has the same density up to walls, edges and corners. A wall's share by the
kernel's integral would hide an error instead, for it takes what lies behind to be at rest density.
"""

import math

import numpy as np


def wendland(r: np.ndarray, h: np.ndarray | float) -> np.ndarray:
    """Wendland C2 [1/m^3] at distance r [m] for the support radius h [m]."""
    q = np.minimum(r / h, 1.0)
    return 21.0 / (2.0 * math.pi) / h**3 * (1.0 - q) ** 4 * (1.0 + 4.0 * q)


def mirrored(
    x: np.ndarray, size: tuple[float, float, float], reach: float
) -> tuple[np.ndarray, np.ndarray]:
    """Positions (m, 3) [m] and all their images behind walls nearer than `reach` [m], and which of
    the n given particles each one is, (m,)."""
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
    """c = sum V_j W(|p - x_j|, h_j) (-) at points (p, 3) [m], over all particles: (p,)."""
    r = np.linalg.norm(points[:, None] - x[None], axis=2)
    return (volume * wendland(r, support)).sum(axis=1)
