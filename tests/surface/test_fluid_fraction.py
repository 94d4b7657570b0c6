import numpy as np
import pytest

from msph.surface.fluid_fraction import POLY6, fluid_fraction, missing
from msph.surface.lattice import Lattice, walled_axis


@pytest.mark.parametrize("t", [0.0, 0.1, 0.35, 0.6, 0.9, 1.0])
def test_missing_part_is_the_integral_of_poly6_beyond_the_plane(t):
    """The integral is a midpoint rule over height z and radius s of the cap beyond z = t, with
    h = 1."""
    n = 2000
    z = t + (np.arange(n) + 0.5) * (1 - t) / n
    s = (np.arange(n) + 0.5) / n
    u = np.maximum(1.0 - z[:, None] ** 2 - s**2, 0.0)
    integral = (POLY6 * u**3 * 2 * np.pi * s).sum() / n * (1 - t) / n
    assert missing(np.array(t)) == pytest.approx(integral, abs=1e-6)


def test_slopes_match_finite_differences():
    e = 1e-5
    x = np.linspace(0.02, 0.28, 27)
    fraction, slope = fluid_fraction(x, 0.3, 0.1)
    ahead, behind = fluid_fraction(x + e, 0.3, 0.1)[0], fluid_fraction(x - e, 0.3, 0.1)[0]
    assert np.allclose((ahead - behind) / (2 * e) / fraction, slope, atol=1e-4)


def test_fraction_is_half_at_a_wall_and_one_inside():
    fraction, slope = fluid_fraction(np.array([0.0, 0.5, 1.0]), 1.0, 0.1)
    assert np.allclose(fraction, [0.5, 1.0, 0.5])
    assert slope[0] > 0.0 and slope[1] == 0.0 and slope[2] == -slope[0]


@pytest.mark.parametrize("length", [1.0, 0.7, 3.3333, 0.05715])
def test_ghosts_mirror_the_wall_nodes_exactly(length):
    axis = walled_axis(length, 0.0279).astype(np.float32)
    wall = np.float32(length)
    half = np.float32(0.5)
    assert axis[0] + half * (axis[1] - axis[0]) == 0.0
    assert axis[-2] + half * (axis[-1] - axis[-2]) == wall
    assert (np.diff(axis) > 0).all() and len(axis) % 2 == 1


def test_lattice_spacing_is_close_to_the_requested_spacing():
    lattice = Lattice.in_box((1.0, 2.0, 0.5), 0.028)
    assert np.allclose(lattice.spacing, 0.028, rtol=0.08)
