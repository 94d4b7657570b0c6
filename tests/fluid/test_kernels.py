"""Kernel functions: their integrals, derivatives and support radii."""

import numpy as np
import pytest
import taichi as ti

from msph.fluid.particles import kernels

H = 0.7
SAMPLES = 4001


@ti.func
def quartic_slope(r, h):
    return kernels.QUARTIC / h**4 * (r / h) * kernels.quartic_shape(r / h).y


PAIRS = {
    "poly6": (kernels.poly6, kernels.poly6_slope),
    "spiky": (kernels.spiky, kernels.spiky_slope),
    "wendland": (kernels.wendland, kernels.wendland_slope),
    "quartic": (kernels.quartic, quartic_slope),
}


@ti.data_oriented
class Evaluator:
    """Values of all kernel functions at the same distances, compiled once: column k of the table
    belongs to functions[k]."""

    functions = (
        *(f for pair in PAIRS.values() for f in pair),
        kernels.poly6_laplacian,
        kernels.viscosity,
        kernels.viscosity_laplacian,
    )

    def __init__(self, r):
        self.r = ti.field(ti.f32, shape=len(r))
        self.r.from_numpy(r.astype(np.float32))
        self.table = ti.field(ti.f32, shape=(len(r), len(self.functions)))
        self.fill()

    @ti.kernel
    def fill(self):
        for i in self.r:
            for k, function in ti.static(enumerate(self.functions)):
                self.table[i, k] = function(self.r[i], H)

    def column(self, function):
        return self.table.to_numpy().astype(float)[:, self.functions.index(function)]


@pytest.fixture(scope="module")
def r():
    return np.linspace(1e-3 * H, 1.2 * H, SAMPLES)


@pytest.fixture(scope="module")
def evaluator(r):
    return Evaluator(r)


@pytest.mark.parametrize("name", PAIRS)
def test_kernel_integrates_to_one(evaluator, r, name):
    w = evaluator.column(PAIRS[name][0])
    assert np.trapezoid(4.0 * np.pi * r**2 * w, r) == pytest.approx(1.0, abs=1e-3)


def test_viscosity_kernel_integrates_to_one(evaluator, r):
    w = evaluator.column(kernels.viscosity)
    assert np.trapezoid(4.0 * np.pi * r**2 * w, r) == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize("name", PAIRS)
def test_slope_is_the_derivative(evaluator, r, name):
    value, slope = (evaluator.column(f) for f in PAIRS[name])
    expected = np.gradient(value, r)
    error = np.abs(slope - expected)[5:-5].max()
    assert error < 2e-3 * np.abs(slope).max()


@pytest.mark.parametrize(
    ("value", "laplacian"),
    [
        (kernels.poly6, kernels.poly6_laplacian),
        (kernels.viscosity, kernels.viscosity_laplacian),
    ],
)
def test_laplacian_is_the_divergence_of_the_gradient(evaluator, r, value, laplacian):
    w, expected = evaluator.column(value), evaluator.column(laplacian)
    inside = (r > 0.3 * H) & (r < 0.95 * H)
    # Coarse differences, because the second derivative of single-precision values is noisy.
    step = 20
    rs, ws = r[::step], w[::step]
    found = np.gradient(rs**2 * np.gradient(ws, rs), rs) / rs**2
    near = np.interp(r[inside], rs, found)
    assert np.abs(near - expected[inside]).max() < 0.05 * np.abs(expected[inside]).max()


@pytest.mark.parametrize("k", range(len(Evaluator.functions)))
def test_kernels_vanish_beyond_their_support(evaluator, r, k):
    assert not np.any(evaluator.table.to_numpy()[r > H * 1.0001, k])
