"""Closed-form shares of the kernel's integral inside bodies, without wall particles.

For a plane at distance s from a particle, lambda(s/h) is the share of the kernel's integral behind
it, exact for every particle size; a block's share is close to the product over its axes. The
integrals use the Wendland C2 kernel (closed forms) with the standard deviation of the fluid's own
kernel.
"""

import taichi as ti

from msph.fluid.particles import kernels
from msph.fluid.particles.layers import LayerSpec

# Smallest distance from a ball's centre, in radii: avoids a division by zero.
SMALLEST = 1e-3


def wall_support(spec: LayerSpec) -> float:
    """Returns the support [m] of the Wendland C2 kernel used in a layer's integrals."""
    return kernels.WENDLAND_PER_QUARTIC * spec.support


@ti.func
def wendland_behind(s, h):
    """Returns the share (-) of the Wendland C2 kernel behind a plane at distance s [m]; s < 0
    beyond it.

    With u = 1 - s/h: 3.5 u^6 - 4.5 u^7 + 1.5 u^8, and lambda(-s) = 1 - lambda(s).
    """
    u = ti.math.clamp(1.0 - abs(s) / h, 0.0, 1.0)
    behind = u**6 * (3.5 + u * (-4.5 + 1.5 * u))
    return ti.select(s >= 0.0, behind, 1.0 - behind)


@ti.func
def wendland_behind_slope(s, h):
    """Returns d lambda/ds [1/m], negative on both sides: -(21 u^5 - 31.5 u^6 + 12 u^7)/h."""
    u = ti.math.clamp(1.0 - abs(s) / h, 0.0, 1.0)
    return -(u**5) * (21.0 + u * (-31.5 + 12.0 * u)) / h


@ti.func
def wendland_tilt(s, h):
    """Returns pi times the integral of (q - s) q^2 W(q) over q from s to h [m], s >= 0: the
    reduction of a wall's share by its curvature 1/R, to first order in h/R.

    With u = 1 - s/h: h u^6 (7/4 - 7/2 u + 39/16 u^2 - 7/12 u^3).
    """
    u = ti.math.clamp(1.0 - s / h, 0.0, 1.0)
    return h * u**6 * (1.75 + u * (-3.5 + u * (2.4375 - u * (7.0 / 12.0))))


@ti.func
def wendland_tilt_slope(s, h):
    """Returns d/ds of wendland_tilt (-): -(10.5 u^5 - 24.5 u^6 + 19.5 u^7 - 5.25 u^8)."""
    u = ti.math.clamp(1.0 - s / h, 0.0, 1.0)
    return -(u**5) * (10.5 + u * (-24.5 + u * (19.5 - 5.25 * u)))


@ti.func
def ball_share(distance, h, radius):
    """Returns the share of the kernel's integral inside a ball, `distance` [m] from its centre, and
    its slope [1/m].

    Exact for every radius [m]. A shell of radius q around the particle has the fraction (R^2 - (D -
    q)^2)/(4 D q) inside the ball, so with s = |D - R| the share is (R + D)/(2 D) lambda(s) -
    tilt(s)/D outside, and 1 minus the corresponding sum inside; shells of radius over R + D are
    subtracted.
    """
    D = ti.max(distance, SMALLEST * radius)
    s, far = D - radius, D + radius
    t, side = abs(s), ti.select(s >= 0.0, 1.0, -1.0)
    plane, tilt = wendland_behind(t, h), wendland_tilt(t, h) / D
    ratio = 0.5 * far / D
    share = ti.select(s >= 0.0, ratio * plane, 1.0 - ratio * plane) - tilt
    slope = ratio * wendland_behind_slope(t, h) - side * 0.5 * plane * radius / (D * D)
    slope -= (side * wendland_tilt_slope(t, h) - tilt) / D
    if far < h:
        back = (wendland_tilt(far, h) - 0.5 * s * wendland_behind(far, h)) / D
        share += back
        slope += wendland_tilt_slope(far, h) / D - back / D
        slope -= 0.5 * (wendland_behind(far, h) + s * wendland_behind_slope(far, h)) / D
    return ti.Vector([share, slope])


@ti.func
def block_share(x, h, lo, hi):
    """Returns the share of the kernel's integral inside the block from lo to hi, and its gradient
    [1/m].

    Product over the axes of the share between two planes, as (value, d/dx, d/dy, d/dz).
    """
    part = ti.Vector([0.0, 0.0, 0.0])
    slope = ti.Vector([0.0, 0.0, 0.0])
    for k in ti.static(range(3)):
        part[k] = wendland_behind(lo[k] - x[k], h) - wendland_behind(hi[k] - x[k], h)
        slope[k] = wendland_behind_slope(hi[k] - x[k], h) - wendland_behind_slope(lo[k] - x[k], h)
    return ti.Vector(
        [
            part[0] * part[1] * part[2],
            slope[0] * part[1] * part[2],
            part[0] * slope[1] * part[2],
            part[0] * part[1] * slope[2],
        ]
    )
