"""Smoothing kernels in three dimensions, as Taichi functions.

Arguments: distance r [m], support radius h [m]. W is in 1/m^3, dW/dr in 1/m^4, the Laplacian in
1/m^5. Equation numbers: Gokdogan 2008; the kernels are those of Mueller et al. 2003,
eq. 20 to 22, Wendland 1995, and Schoenberg 1946.
"""

import math

import taichi as ti

POLY6 = 315.0 / (64.0 * math.pi)
SPIKY = 15.0 / math.pi
VISCOSITY = 15.0 / (2.0 * math.pi)
WENDLAND = 21.0 / (2.0 * math.pi)
QUARTIC = 15625.0 / (512.0 * math.pi)
# Normalisation of the bell kernel (1 - q^2)^4.
BELL = 3465.0 / (512.0 * math.pi)
# Value of quartic_shape at 0: 1 - 5 (3/5)^4 + 10 (1/5)^4.
QUARTIC_PEAK = 0.368
# Ratio of the supports of a Wendland C2 and a quartic kernel of equal standard deviation (Dehnen
# and Aly 2012, table 1).
WENDLAND_PER_QUARTIC = 1.936492 / 2.018932
# Distance of a particle from its own image, in spacings, below which the image repels it, and what
# it adds to c at distance 0 (-). At rest the first sheet stands half a spacing from a wall, one
# spacing from its image; the kernel's slope vanishes at 0, so sheets would also rest on the wall.
OWN_IMAGE_REACH, OWN_IMAGE = 0.7, 0.1
# Smallest divisor of a slope, in supports: avoids a division by zero.
NEAR = 1e-3


@ti.func
def poly6(r, h):
    """Eq. 29: 315/(64 pi h^9) (h^2 - r^2)^3."""
    u = ti.max(1.0 - (r / h) ** 2, 0.0)
    return POLY6 / h**3 * u * u * u


@ti.func
def poly6_slope(r, h):
    """dW/dr of eq. 29: -6 r 315/(64 pi h^9) (h^2 - r^2)^2."""
    u = ti.max(1.0 - (r / h) ** 2, 0.0)
    return -6.0 * POLY6 / h**5 * r * u * u


@ti.func
def poly6_laplacian(r, h):
    """Laplacian of eq. 29: -6 315/(64 pi h^9) (h^2 - r^2) (3 h^2 - 7 r^2)."""
    q2 = (r / h) ** 2
    u = ti.max(1.0 - q2, 0.0)
    return -6.0 * POLY6 / h**5 * u * (3.0 - 7.0 * q2)


@ti.func
def spiky(r, h):
    """Eq. 30: 15/(pi h^6) (h - r)^3."""
    u = ti.max(1.0 - r / h, 0.0)
    return SPIKY / h**3 * u * u * u


@ti.func
def spiky_slope(r, h):
    """dW/dr of eq. 30: -45/(pi h^6) (h - r)^2. Not zero at r = 0, so that close pairs repel."""
    u = ti.max(1.0 - r / h, 0.0)
    return -3.0 * SPIKY / h**4 * u * u


@ti.func
def viscosity(r, h):
    """Eq. 31: 15/(2 pi h^3) (-r^3/(2 h^3) + r^2/h^2 + h/(2 r) - 1), singular at r = 0."""
    q = r / h
    w = -0.5 * q * q * q + q * q + 0.5 / q - 1.0
    return ti.select(q < 1.0, VISCOSITY / h**3 * w, 0.0)


@ti.func
def viscosity_laplacian(r, h):
    """Laplacian of eq. 31: 45/(pi h^6) (h - r), positive, so that viscosity dissipates energy."""
    return 6.0 * VISCOSITY / h**5 * ti.max(1.0 - r / h, 0.0)


@ti.func
def wendland(r, h):
    """Wendland C2: 21/(2 pi h^3) (1 - r/h)^4 (1 + 4 r/h)."""
    q = r / h
    u = ti.max(1.0 - q, 0.0)
    return WENDLAND / h**3 * u * u * u * u * (1.0 + 4.0 * q)


@ti.func
def wendland_slope(r, h):
    """dW/dr of Wendland C2: -20 r/h^2 21/(2 pi h^3) (1 - r/h)^3."""
    q = r / h
    u = ti.max(1.0 - q, 0.0)
    return -20.0 * WENDLAND / h**4 * q * u * u * u


@ti.func
def quartic_shape(q):
    """Quartic B-spline M5 (Schoenberg 1946) of support 1 without its factor 15625/(512 pi): w = (1
    - q)^4 - 5 (3/5 - q)^4 + 10 (1/5 - q)^4, each term only where its bracket is positive; returns
    (w, w'/q, w'')."""
    a, b, c = ti.max(1.0 - q, 0.0), ti.max(0.6 - q, 0.0), ti.max(0.2 - q, 0.0)
    a2, b2, c2 = a * a, b * b, c * c
    w = a2 * a2 - 5.0 * b2 * b2 + 10.0 * c2 * c2
    slope = -4.0 * (a * a2 - 5.0 * b * b2 + 10.0 * c * c2)
    return ti.math.vec3(w, slope / ti.max(q, NEAR), 12.0 * (a2 - 5.0 * b2 + 10.0 * c2))


@ti.func
def quartic(r, h):
    """M5: 15625/(512 pi h^3) quartic_shape(r/h)."""
    return QUARTIC / h**3 * quartic_shape(r / h).x


@ti.func
def own_image(q):
    """Returns E and dE/dq (-) of a particle's own image at the distance q, in spacings. E is added
    to c, so that the image repels the particle: 0.1 (1 - q/0.7)^2."""
    u = ti.max(1.0 - q / OWN_IMAGE_REACH, 0.0)
    return OWN_IMAGE * u * ti.math.vec2(u, -2.0 / OWN_IMAGE_REACH)
