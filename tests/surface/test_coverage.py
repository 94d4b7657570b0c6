import numpy as np
import pytest
from surface_kit import FINE, SIZE

from msph.surface.band import RIM_LOSS, STRIDE, corner_bound
from msph.surface.fluid_fraction import ISO, fluid_fraction


def field(water):
    """Returns coverage and its gradient at every node but the ghosts, and the nodes'
    coordinates."""
    water.mesh(everywhere=True)
    cubes, real = water.surface.cubes, (slice(1, -1),) * 3
    axes = [a[1:-1].astype(np.float64) for a in water.surface.lattice.axes]
    return water.nodes(cubes.value)[real] + ISO, water.nodes(cubes.gradient)[real], axes


def brute_force(water):
    """Returns the coverage by the formula of sums.py in f64, as a function of a point [m]."""
    positions = water.particles.numpy("x").astype(np.float64)
    layer = water.particles.numpy("layer")
    thin = water.surface.thin
    reach = thin.by_layer.reach.to_numpy()[: water.layers.count]
    n = len(positions)
    per_r2, weight = thin.kernel.to_numpy()[:n].astype(np.float64).T
    narrow = per_r2 > 1.0 / reach[layer] ** 2
    assert narrow.any()
    inverse = per_r2[:, None, None] * np.eye(3)
    for m, entries in enumerate((thin.squares, thin.products)):
        values = entries.to_numpy()[:n][narrow]
        for k in range(3):
            i, j = ((k, k), ((k + 1) % 3, (k + 2) % 3))[m]
            inverse[narrow, i, j] = inverse[narrow, j, i] = values[:, k]
    positions[narrow] = thin.centre.to_numpy()[:n][narrow]

    def coverage(x: np.ndarray) -> float:
        y = x - positions
        u = np.maximum(1.0 - np.einsum("ni,nij,nj->n", y, inverse, y), 0.0)
        total = 0.0
        for number, r in enumerate(reach):
            fraction = np.prod([fluid_fraction(x[a], SIZE[a], r)[0] for a in range(3)])
            total += (weight * u**3)[layer == number].sum() / fraction
        return total

    return coverage


@pytest.mark.parametrize("kind", ["water", "smooth_water"])
def test_value_and_gradient_match_brute_force(kind, request):
    water = request.getfixturevalue(kind)
    rng = np.random.default_rng(2)
    water.fill(rng.uniform(0.0, SIZE, (3000, 3)), rng.integers(0, 2, 3000))
    value, gradient, axes = field(water)
    exact, e = brute_force(water), 1e-6
    for _ in range(60):
        i, j, k = (int(rng.integers(0, n)) for n in value.shape)
        if rng.random() < 0.3:
            i = 0
        x = np.array([axes[0][i], axes[1][j], axes[2][k]])
        assert value[i, j, k] == pytest.approx(exact(x), rel=1e-4, abs=1e-5)
        slope = [(exact(x + e * d) - exact(x - e * d)) / (2 * e) for d in np.eye(3)]
        scale = 1.0 / FINE
        assert np.allclose(gradient[i, j, k], slope, rtol=1e-3, atol=1e-3 * scale)


@pytest.mark.parametrize("spacing", [(0.15, 0.15, 0.15), (0.3, 0.22, 0.27), (0.35, 0.35, 0.35)])
def test_bound_holds_for_single_particles(spacing):
    """Trilinear interpolation of poly6 in a sub-block is at least rho poly6 - RIM_LOSS."""
    rng = np.random.default_rng(0)
    sides = STRIDE * np.array(spacing)
    x = rng.random((60_000, 3))
    x[:20_000] = 0.5  # the centres of the sub-block, its faces and its edges are worst
    x[20_000:40_000, 0] = 0.0
    x[30_000:40_000, 1] = 0.0
    p = x + rng.normal(size=x.shape) * rng.choice([0.05, 0.3, 1.0], (len(x), 1))

    def w(q):
        return np.maximum(1.0 - (((q - p) * sides) ** 2).sum(axis=1), 0.0) ** 3

    mixed = np.zeros(len(x))
    for corner in np.ndindex(2, 2, 2):
        weight = np.prod(np.where(np.array(corner) == 1, x, 1.0 - x), axis=1)
        mixed += weight * w(np.array(corner, dtype=float))
    assert (mixed >= corner_bound(spacing, 1.0) * w(x) - RIM_LOSS).all()


def test_too_coarse_cells_are_refused(water):
    with pytest.raises(ValueError, match="too coarse"):
        water.surface.load(SIZE, 2 * FINE)
