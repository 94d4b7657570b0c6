"""Tests of the bulk density of particles whose density is known: lattices, disorder, layers."""

import numpy as np
import pytest

from msph.measure.bulk import KERNEL_RADIUS, bulk_density
from msph.measure.host_kernels import epanechnikov, mirrored

SIZE = (0.8, 0.8, 0.8)
D = 0.04


def lattice(height, d, base=0.0):
    """Returns the positions [m] of a cubic lattice fitted to the floor, and the spacing [m] that
    corresponds to the volume of each particle."""
    counts = np.round(np.array([SIZE[0], height, SIZE[2]]) / d).astype(int)
    edges = np.array([SIZE[0], height, SIZE[2]]) / counts
    x = (np.indices(counts).reshape(3, -1).T + 0.5) * edges + [0, base, 0]
    return x, np.full(len(x), np.prod(edges) ** (1 / 3))


@pytest.mark.parametrize("height", [0.32, 0.8])
def test_bulk_density_of_a_lattice_at_rest_is_one_up_to_the_walls(height):
    found = bulk_density(*lattice(height, D), SIZE)
    assert found.points > 300
    assert found.mean == pytest.approx(1.0, abs=2e-4)
    assert found.least > 1 - 5e-3 and found.most < 1 + 5e-3


@pytest.mark.parametrize("excess", [0.2, -0.2])
def test_compressed_and_expanded_lattices_have_their_bulk_density(excess):
    """The density is 1.2 or 0.8 if particles have 20 % more or less volume than their cells."""
    x, d = lattice(0.4, D)
    found = bulk_density(x, d * (1 + excess) ** (1 / 3), SIZE)
    assert found.mean == pytest.approx(1 + excess, abs=1e-3)


def test_bodies_do_not_lower_the_bulk_density():
    """A plate 1.5 spacings thick has no point that is far enough from particles to count as air;
    without `free`, the water next to it therefore appears too thin."""
    x, d = lattice(0.8, D)
    lo, hi = 0.4 - 0.75 * D, 0.4 + 0.75 * D
    outside = (x[:, 0] < lo) | (x[:, 0] > hi)
    assert outside.sum() < len(x)

    def free(points, margin):
        return (points[:, 0] < lo - margin) | (points[:, 0] > hi + margin)

    blind = bulk_density(x[outside], d[outside], SIZE)
    seeing = bulk_density(x[outside], d[outside], SIZE, free)
    assert blind.least < 0.8
    assert seeing.points > 100
    assert seeing.least > 1 - 3e-3


@pytest.mark.parametrize("ratio", [2 ** (1 / 3), 2.0, 5.0])
def test_bulk_density_of_layers_of_unequal_particles_is_one(ratio):
    """The bulk density is 1 across abrupt interfaces of mass ratios 1 : 2, 1 : 8 and 1 : 125."""
    (xc, dc), (xf, df) = lattice(0.32, D), lattice(0.32, D / ratio, base=0.32)
    found = bulk_density(np.concatenate([xc, xf]), np.concatenate([dc, df]), SIZE)
    assert found.mean == pytest.approx(1.0, abs=3e-3)
    assert found.least > 0.97 and found.most < 1.03


def test_stratification_changes_the_extremes_of_the_bulk_density():
    """The extremes follow a compression towards the floor: with y = H (t - a t (1 - t)) the density
    is 1/(1 - a (1 - 2 t))."""
    x, d = lattice(0.6, 0.025)
    t, a = x[:, 1] / 0.6, 0.1
    x[:, 1] = 0.6 * (t - a * t * (1 - t))
    found = bulk_density(x, d, SIZE)
    assert found.most == pytest.approx(1 / (1 - a), abs=0.02)
    # The highest kernels that lie in the water reach from t = 0.7 to 1 or slightly less.
    assert found.least == pytest.approx(1 / (1 - a * (1 - 2 * 0.83)), abs=0.015)


def test_bulk_density_of_very_shallow_water_is_unknown():
    found = bulk_density(*lattice(0.12, D), SIZE)
    assert found.points == 0 and np.isnan(found.mean)


def test_narrower_kernels_measure_shallow_water():
    assert bulk_density(*lattice(0.2, D), SIZE).mean == pytest.approx(1.0, abs=2e-3)
    x, d = lattice(0.2, D)
    assert bulk_density(x, d * 1.1 ** (1 / 3), SIZE).mean == pytest.approx(1.1, abs=3e-3)


def test_bulk_density_of_a_pocket_of_fine_water_in_coarse_water_is_one():
    """The coarse water is too shallow for its own kernel."""
    (xc, dc), (xf, df) = lattice(0.4, 0.1), lattice(0.4, 0.02)
    pocket, outside = (xf < 0.3).all(axis=1), (xc > 0.3).any(axis=1)
    x, d = np.concatenate([xc[outside], xf[pocket]]), np.concatenate([dc[outside], df[pocket]])
    assert bulk_density(x, d, SIZE).mean == pytest.approx(1.0, abs=2e-3)


def test_wide_kernel_is_normalised_and_walls_mirror_particles():
    r = np.linspace(0.0, KERNEL_RADIUS, 4001)
    whole = np.trapezoid(4 * np.pi * r**2 * epanechnikov(r, KERNEL_RADIUS), r)
    assert whole == pytest.approx(1.0, abs=1e-6)
    x, which = mirrored(np.array([[0.01, 0.4, 0.79]]), SIZE, 0.05)
    images = {(0.01, 0.79), (-0.01, 0.79), (0.01, 0.81), (-0.01, 0.81)}
    assert {(round(a, 9), round(b, 9)) for a, _, b in x} == images and (which == 0).all()
