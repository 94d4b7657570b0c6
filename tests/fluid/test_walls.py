"""Shares of the kernel behind walls, compared with integrals and finite differences."""

import numpy as np
import pytest
import taichi as ti

from msph.fluid.boundary.wall_integrals import block_share, wendland_behind

H = 0.3
SIZE = (1.0, 0.5, 0.8)


class Evaluator:
    """Shares, with gradients, (n, 4) of a block at points, and shares (m,) behind a plane at given
    distances; arrays, since a process has room for few fields."""

    def __init__(self, points, distances):
        x, s = np.asarray(points, np.float32), np.asarray(distances, np.float32)
        self.share, self.behind = np.zeros((len(x), 4), np.float32), np.zeros(len(s), np.float32)
        evaluate(x, s, self.share, self.behind)


@ti.kernel
def evaluate(
    x: ti.types.ndarray(dtype=ti.f32, ndim=2),
    s: ti.types.ndarray(dtype=ti.f32, ndim=1),
    share: ti.types.ndarray(dtype=ti.f32, ndim=2),
    behind: ti.types.ndarray(dtype=ti.f32, ndim=1),
):
    for i in range(x.shape[0]):
        at = ti.Vector([x[i, 0], x[i, 1], x[i, 2]])
        found = block_share(at, H, ti.Vector([0.0] * 3), ti.Vector(SIZE))
        for k in ti.static(range(4)):
            share[i, k] = found[k]
    for i in range(s.shape[0]):
        behind[i] = wendland_behind(s[i], H)


def points():
    rng = np.random.default_rng(2)
    x = rng.uniform(0.0, 1.0, (200, 3)) * SIZE
    x[:40, 0] *= 0.1
    return x


@pytest.fixture(scope="module")
def evaluator():
    step = 1e-3
    x = points()
    shifted = [x + step * np.eye(3)[k] * sign for k in range(3) for sign in (1, -1)]
    return Evaluator(np.concatenate([x, *shifted]), np.linspace(-1.2 * H, 1.2 * H, 41))


def test_share_behind_a_plane_is_the_kernels_integral(evaluator):
    """The share equals the integral over slabs: at height z the kernel's disc is the integral of
    2 pi rho W over rho."""
    z = np.linspace(-H, H, 801)
    rho = np.linspace(0.0, H, 1201)
    r = np.hypot(z[:, None], rho[None])
    u = np.clip(1 - r / H, 0, None)
    w = 21 / (2 * np.pi * H**3) * u**4 * (1 + 4 * r / H)
    disc = np.trapezoid(2 * np.pi * rho * w, rho, axis=1)
    s, found = np.linspace(-1.2 * H, 1.2 * H, 41), evaluator.behind
    for distance, share in zip(s, found, strict=True):
        behind = np.where(z >= distance, disc, 0.0)
        assert share == pytest.approx(np.trapezoid(behind, z), abs=3e-3)


def test_gradient_is_the_derivative_of_the_share(evaluator):
    n = len(points())
    share = evaluator.share
    for k in range(3):
        up = share[n * (1 + 2 * k) : n * (2 + 2 * k), 0]
        down = share[n * (2 + 2 * k) : n * (3 + 2 * k), 0]
        assert np.abs((up - down) / 2e-3 - share[:n, 1 + k]).max() < 0.02 / H


def test_a_corner_of_a_block_contains_an_eighth_of_the_kernel():
    corner = Evaluator([(0.0, 0.0, 0.0), (0.5, 0.25, 0.4)], [0.0])
    assert corner.share[0, 0] == pytest.approx(1 / 8, abs=1e-6)
    # 0.25 m from two faces with h = 0.3 m: a small share of the kernel lies beyond each of them.
    assert 0.99 < corner.share[1, 0] < 1.0
