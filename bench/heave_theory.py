"""Heave decay of a half-submerged ball in deep water by potential flow.

The equation of Cummins 1962 with the added mass and damping of Hulme 1982 and the buoyancy of the
whole ball. The radiated waves are linear, the water is endless and has no viscosity.
"""

import numpy as np
from scipy.interpolate import PchipInterpolator

# Hulme 1982, J. Fluid Mech. 121, 443: wave number times radius, added mass and damping over the
# displaced mass (damping also over the frequency). Kramers and Kronig's relation gives the added
# mass from the damping within 0.1 % from ka = 0.1 on.
HULME = np.array(
    [
        (0.0, 0.8310, 0.0),
        (0.05, 0.8764, 0.1036),
        (0.1, 0.8627, 0.1816),
        (0.2, 0.7938, 0.2793),
        (0.3, 0.7157, 0.3254),
        (0.4, 0.6452, 0.3410),
        (0.5, 0.5861, 0.3391),
        (0.6, 0.5381, 0.3271),
        (0.7, 0.4999, 0.3098),
        (0.8, 0.4698, 0.2899),
        (0.9, 0.4464, 0.2691),
        (1.0, 0.4284, 0.2484),
        (1.2, 0.4047, 0.2096),
        (1.4, 0.3924, 0.1756),
        (1.6, 0.3871, 0.1469),
        (1.8, 0.3864, 0.1229),
        (2.0, 0.3884, 0.1031),
        (2.5, 0.3988, 0.0674),
        (3.0, 0.4111, 0.0452),
        (4.0, 0.4322, 0.0219),
        (5.0, 0.4471, 0.0116),
        (6.0, 0.4574, 0.0066),
        (7.0, 0.4647, 0.0040),
        (8.0, 0.4700, 0.0026),
        (9.0, 0.4740, 0.0017),
        (10.0, 0.4771, 0.0012),
    ]
)
# Added mass at infinite frequency (-); time step and frequency step in units of sqrt(a/g).
FASTEST, STEP, FREQUENCIES = 0.5, 0.005, 4000


def decay(release: float, radius: float, gravity: float, seconds: float) -> tuple:
    """Returns times [s] and heights [m] above equilibrium, (n,), of a ball of `radius` [m] that is
    released at rest at the height `release` [m]."""
    unit = (radius / gravity) ** 0.5
    t = np.arange(0.0, seconds / unit, STEP)
    rate = np.linspace(0.0, HULME[-1, 0] ** 0.5, FREQUENCIES)
    rates = HULME[:, 0] ** 0.5
    damping = PchipInterpolator(rates, rates * HULME[:, 2])(rate)
    # Memory of the radiated waves: 2/pi times the cosine transform of the damping.
    weights = 2.0 / np.pi * damping * (rate[1] - rate[0])
    memory = np.array([weights @ np.cos(rate * s) for s in t])
    z, v = np.zeros_like(t), np.zeros_like(t)
    z[0] = release / radius
    for i in range(len(t) - 1):
        past = memory[: i + 1][::-1] @ v[: i + 1] - 0.5 * memory[0] * v[i]
        # Submerged volume over the displaced one at rest, less 1.
        buoyancy = -1.5 * (z[i] - z[i] ** 3 / 3.0)
        v[i + 1] = v[i] + STEP * (buoyancy - STEP * past) / (1.0 + FASTEST)
        z[i + 1] = z[i] + STEP * v[i + 1]
    return t * unit, z * radius
