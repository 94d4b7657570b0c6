"""Walls without wall particles: what is missing of the kernel's integral beyond a plane.

For a plane at distance s from a particle, lambda(s/h) is the share of the kernel's integral that
lies behind it: a function of one variable, exact for every particle size. Inside a box the fluid's
share is close to the product over the walls of (1 - lambda); summing over-counts edges and corners.
"""

import taichi as ti


@ti.func
def wendland_behind(s, h):
    """Share of the Wendland C2 kernel behind a plane at distance s [m], s < 0 beyond it (-).

    With u = 1 - s/h: 3.5 u^6 - 4.5 u^7 + 1.5 u^8, and lambda(-s) = 1 - lambda(s).
    """
    u = ti.math.clamp(1.0 - abs(s) / h, 0.0, 1.0)
    behind = u**6 * (3.5 + u * (-4.5 + 1.5 * u))
    return ti.select(s >= 0.0, behind, 1.0 - behind)


@ti.func
def wendland_behind_slope(s, h):
    """d lambda/ds [1/m], negative: -(21 u^5 - 31.5 u^6 + 12 u^7)/h, the same on both sides."""
    u = ti.math.clamp(1.0 - abs(s) / h, 0.0, 1.0)
    return -(u**5) * (21.0 + u * (-31.5 + 12.0 * u)) / h


@ti.func
def wall_share(x, h, size):
    """The walls' part of the relative density at x [m] in a box, and its gradient [1/m].

    1 - product over the six walls of (1 - lambda), as (value, d/dx, d/dy, d/dz).
    """
    open_share = ti.Vector([1.0, 1.0, 1.0])
    slope = ti.Vector([0.0, 0.0, 0.0])
    for k in ti.static(range(3)):
        lo, hi = x[k], size[k] - x[k]
        if ti.min(lo, hi) < h:
            free_lo = 1.0 - wendland_behind(lo, h)
            free_hi = 1.0 - wendland_behind(hi, h)
            open_share[k] = free_lo * free_hi
            slope[k] = free_hi * wendland_behind_slope(lo, h)
            slope[k] -= free_lo * wendland_behind_slope(hi, h)
    return ti.Vector(
        [
            1.0 - open_share[0] * open_share[1] * open_share[2],
            slope[0] * open_share[1] * open_share[2],
            slope[1] * open_share[0] * open_share[2],
            slope[2] * open_share[0] * open_share[1],
        ]
    )
