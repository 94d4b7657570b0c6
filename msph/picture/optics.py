"""Optics of a smooth water surface: Snell, Fresnel, Beer-Lambert."""

import numpy as np
import taichi as ti


def refracted(d, n, eta):
    """Returns the unit direction d refracted at the unit normal n (against d), in NumPy;
    eta = n_from / n_to."""
    c = -np.dot(d, n)
    return eta * d + (eta * c - np.sqrt(1 - eta**2 * (1 - c * c))) * n


@ti.func
def cosine_beyond(c, eta):
    """Returns the cosine of refraction for the cosine of incidence c, eta = n_from / n_to; 0: total
    reflection."""
    return ti.sqrt(ti.max(0.0, 1.0 - eta * eta * (1.0 - c * c)))


@ti.func
def bend(d, n, c, ct, eta):
    """Returns the refracted unit direction; c, ct: cosines of incidence and refraction."""
    return eta * d + (eta * c - ct) * n


@ti.func
def reflectance(c, ct, eta):
    """Returns the unpolarised Fresnel reflectance of a dielectric; 1 for total reflection (ct = 0).

    R = (rs^2 + rp^2) / 2, rs = (eta c - ct) / (eta c + ct), rp = (c - eta ct) / (c + eta ct).
    """
    rs = (eta * c - ct) / (eta * c + ct + 1e-7)
    rp = (c - eta * ct) / (c + eta * ct + 1e-7)
    return 0.5 * (rs * rs + rp * rp)


@ti.func
def transmittance(absorption, path):
    """Returns the Beer-Lambert transmittance of `path` metres, RGB."""
    return ti.exp(-absorption * path)
