"""Bodies without wall particles: the part of the kernel's integral that lies inside a body.

For a plane at distance s from a particle, lambda(s/h) is the share of the kernel's integral that
lies behind it: a function of one variable, exact for every particle size. A block's is close to the
product of those of its axes.

Integrals are those of the Wendland C2 kernel, which are closed, and of the standard deviation of
the water's own kernel.
"""

import taichi as ti

from msph.fluid.particles import kernels
from msph.fluid.particles.layers import LayerSpec

# How much larger bodies are for the kernels, in spacings: particles sit in the peaks of their own
# kernels, so that along a face they read more than its mean. Without, sunk balls of radius 1.2 to 6
# spacings were borne by 92 to 98.6 % of the displaced weight (docs/method.md, "Walls and bodies").
SWELL = 0.03
# Least distance from a ball's centre, in radii: avoids a division by zero.
SMALLEST = 1e-3


def wall_support(spec: LayerSpec) -> float:
    """Support [m] of the Wendland C2 kernel whose integrals stand for a layer's own."""
    return kernels.WENDLAND_PER_QUARTIC * spec.support


def swelling(spec: LayerSpec) -> float:
    """By how much [m] the faces of bodies stand farther out for a layer's kernel."""
    return SWELL * spec.spacing


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
def wendland_tilt(s, h):
    """pi times the integral of (q - s) q^2 W(q) over q from s to h [m], s >= 0: what curvature
    1/R of a wall takes from its share, to first order in h/R.

    With u = 1 - s/h: h u^6 (7/4 - 7/2 u + 39/16 u^2 - 7/12 u^3).
    """
    u = ti.math.clamp(1.0 - s / h, 0.0, 1.0)
    return h * u**6 * (1.75 + u * (-3.5 + u * (2.4375 - u * (7.0 / 12.0))))


@ti.func
def wendland_tilt_slope(s, h):
    """d/ds of wendland_tilt (-): -(10.5 u^5 - 24.5 u^6 + 19.5 u^7 - 5.25 u^8)."""
    u = ti.math.clamp(1.0 - s / h, 0.0, 1.0)
    return -(u**5) * (10.5 + u * (-24.5 + u * (19.5 - 5.25 * u)))


@ti.func
def ball_share(distance, h, radius):
    """Share of the kernel's integral inside a ball, `distance` [m] from its centre, and its slope.

    Exact for every radius [m]: a shell of radius q round the particle has the part
    (R^2 - (D - q)^2)/(4 D q) in the ball, so that with s = |D - R| the share is
    (R + D)/(2 D) lambda(s) - tilt(s)/D outside, 1 less the like sum inside; shells beyond the
    ball, of radius over R + D, are taken back. Slope in 1/m.
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
    """Share of the kernel's integral inside the block from lo to hi, and its gradient [1/m].

    The product over the axes of the shares between two planes, (value, d/dx, d/dy, d/dz).
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
