"""Tests of the relief of water in the air: it moves with the water, and slopes fit heights."""

import numpy as np
import taichi as ti
from surface_kit import FINE, packed

from msph.surface.relief import STEEP, WAVELENGTH

LUMP = packed((0.2, 0.2, 0.2), (0.4, 0.4, 0.4), FINE, 0.05)
PLACES = np.random.default_rng(3).uniform(0.25, 0.35, (500, 3))


@ti.kernel
def read(relief: ti.template(), x: ti.types.ndarray(dtype=ti.f32, ndim=2)):
    for q in range(x.shape[0]):
        found = relief.at(ti.math.vec3(x[q, 0], x[q, 1], x[q, 2]))
        for a in ti.static(range(4)):
            x[q, a] = found[a]


def relief(water, places, v=(0.0, 0.0, 0.0)) -> np.ndarray:
    """Returns slope and height (-) of the relief at places (n, 3) [m] of the water of the last
    fill, moving at v [m/s]."""
    water.simulation.particles.v.fill(ti.math.vec3(v))
    water.mesh()
    found = np.zeros((len(places), 4), np.float32)
    found[:, :3] = places
    read(water.surface.thin.relief, found)
    return found


def test_relief_moves_with_the_water(water):
    water.fill(LUMP)
    before = relief(water, PLACES)
    step = np.array((0.03, 0.02, -0.01))
    water.fill(LUMP + step)
    assert np.abs(relief(water, PLACES + step) - before).max() < 2e-3
    assert np.abs(relief(water, PLACES) - before).max() > 0.5


def test_slopes_are_those_of_the_heights(water):
    """The slope is STEEP by the gradient of the height, over the wave number 2 pi/(WAVELENGTH d),
    without the gradient of the weights."""
    water.fill(LUMP)
    step, height = 0.01 * FINE, []
    for way in (step, -step):
        ahead = PLACES + way * np.eye(3)[:, None]
        height.append(relief(water, ahead.reshape(-1, 3))[:, 3].reshape(3, -1))
    gradient = (height[0] - height[1]).T / (2.0 * step) * WAVELENGTH * FINE / (2.0 * np.pi)
    slope = relief(water, PLACES)[:, :3] / STEEP
    error = np.sqrt(((slope - gradient) ** 2).sum(axis=1).mean())
    assert error < 0.35 * np.sqrt((gradient**2).sum(axis=1).mean())
    assert 0.4 < np.sqrt((slope**2).sum(axis=1).mean()) < 0.8  # waves of vectors in the unit ball


def test_fast_water_has_streaks(water):
    water.fill(LUMP)
    found = np.abs(relief(water, PLACES, (0.0, -3.0, 0.0))).mean(axis=0)
    assert found[1] < 0.5 * min(found[0], found[2])


def test_there_is_no_relief_without_particles(water):
    water.fill(LUMP)
    assert not relief(water, np.full((1, 3), 0.5)).any()
