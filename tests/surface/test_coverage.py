import numpy as np
import pytest
from surface_kit import COARSE, FINE, SIZE, packed

from msph.surface.band import MARGIN, STRIDE, Band, bound
from msph.surface.walls import POLY6, fluid_fraction


def field(water):
    """Coverage and its gradient at every real node, and the nodes' coordinates."""
    water.surface.extract(everywhere=True)
    cubes, shape = water.surface.cubes, water.surface.lattice.shape
    real = tuple(slice(1, n - 1) for n in shape)
    axes = [a[1:-1].astype(np.float64) for a in water.surface.lattice.axes]
    value = cubes.value.to_numpy()[real] + water.surface.coverage.iso
    return value, cubes.gradient.to_numpy()[real], axes


def exact(water, x: np.ndarray) -> float:
    """The formula in sums.py in f64, by brute force."""
    positions = water.particles.numpy("x").astype(np.float64)
    layer = water.particles.numpy("layer")
    total = 0.0
    for number in range(water.layers.count):
        h = water.surface.coverage.sums.radii[number]
        u = 1.0 - ((positions[layer == number] - x) ** 2).sum(axis=1) / h**2
        part = float(water.layers.volume[number]) * POLY6 / h**3 * (np.maximum(u, 0.0) ** 3).sum()
        for a in range(3):
            part /= fluid_fraction(x[a], SIZE[a], h)[0]
        total += part
    return total


@pytest.mark.parametrize("kind", ["water", "smooth_water"])
def test_value_and_gradient_match_brute_force(kind, request):
    water = request.getfixturevalue(kind)
    rng = np.random.default_rng(2)
    water.fill(rng.uniform(0.0, SIZE, (3000, 3)), rng.integers(0, 2, 3000))
    value, gradient, axes = field(water)
    for _ in range(60):
        i, j, k = (int(rng.integers(0, n)) for n in value.shape)
        if rng.random() < 0.3:
            i = 0
        x = np.array([axes[0][i], axes[1][j], axes[2][k]])
        assert value[i, j, k] == pytest.approx(exact(water, x), rel=1e-4, abs=1e-5)
        e = 1e-6
        slope = [(exact(water, x + e * d) - exact(water, x - e * d)) / (2 * e) for d in np.eye(3)]
        scale = 1.0 / FINE
        assert np.allclose(gradient[i, j, k], slope, rtol=1e-3, atol=1e-3 * scale)


@pytest.mark.parametrize(("d", "layer"), [(FINE, 0), (COARSE, 1)])
def test_coverage_is_one_up_to_the_walls(water, d, layer):
    x = packed((0, 0, 0), SIZE, d)
    water.fill(x, layer)
    rest = len(x) * float(water.layers.volume[layer]) / np.prod(SIZE)
    value = field(water)[0] / rest
    assert abs(value - 1.0).max() < 0.03


def test_bound_holds_for_single_particles():
    """Trilinear interpolation of poly6 from the corners of a sub-block is at least rho times it."""
    rng = np.random.default_rng(0)
    spacing, r = (0.3, 0.22, 0.27), 1.0
    sides = STRIDE * np.array(spacing)
    rho = bound(spacing, r)
    assert 0.3 < rho < 1.0
    x = rng.random((20_000, 3))
    p = rng.uniform(-1.0, 2.0, (20_000, 3))
    p[:5000] = x[:5000] + rng.normal(scale=0.05, size=(5000, 3))
    p[5000:6000] = x[5000:6000] = 0.5 + rng.normal(scale=0.01, size=(1000, 3))

    def w(q):
        return np.maximum(1.0 - (((q - p) * sides) ** 2).sum(axis=1) / r**2, 0.0) ** 3

    mixed = np.zeros(len(x))
    for corner in np.ndindex(2, 2, 2):
        weight = np.prod(np.where(np.array(corner) == 1, x, 1.0 - x), axis=1)
        mixed += weight * w(np.array(corner, dtype=float))
    assert (mixed >= rho * w(x) - 1e-12).all()
    assert 0.0 < MARGIN < 1.0


def test_too_coarse_cells_are_refused(water):
    class Sums:
        radii = np.array([0.5 * max(water.surface.lattice.spacing)])

    with pytest.raises(ValueError, match="too coarse"):
        Band(water.surface.lattice, water.surface.blocks, Sums(), 0.5)
