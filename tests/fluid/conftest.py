import numpy as np
import pytest

from tests.fluid.fluid_kit import ball, simulate, spec_of


@pytest.fixture
def collision():
    """Returns a simulation of a fine and a coarse ball (masses of particles 1 : 8) that collide off
    centre."""
    fine = ball((0.67, 0.82, 0.8), 0.12, 0.03, offset=0.0)
    coarse = ball((0.96, 0.78, 0.8), 0.15, 0.06, offset=0.0)
    x, first = np.concatenate([fine, coarse]), np.arange(len(fine) + len(coarse)) < len(fine)
    v = np.where(first, 1.5, -1.0)[:, None] * [1.0, 0.0, 0.0]
    x += np.random.default_rng(0).uniform(-1e-3, 1e-3, x.shape)
    return simulate((1.6, 1.6, 1.6), [spec_of(d, 2.5) for d in (0.03, 0.06)], x, ~first, v)
