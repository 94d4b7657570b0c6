"""Tests of spray: volume of droplets, continuous motion, and meshes without spray."""

import numpy as np
import pytest
import taichi as ti
from surface_kit import FINE, SIZE, packed

from msph.surface.spray import DROPLETS, FADE, SPREADING, pattern

VOLUME = FINE**3
FRAME = 1.0 / 60.0


@ti.kernel
def read_droplets(spray: ti.template(), found: ti.types.ndarray(dtype=ti.f32, ndim=2)):
    for q in range(spray.count[None] * DROPLETS):
        x, radius, _ = spray.droplet(spray.loose[q // DROPLETS], q % DROPLETS)
        for a in ti.static(range(3)):
            found[q, a] = x[a]
        found[q, 3] = radius


def droplets(water) -> np.ndarray:
    """Returns places and radii [m] of the droplets of the last mesh, (particles, DROPLETS, 4), in
    the order of the particles."""
    spray = water.surface.thin.spray
    order = np.argsort(spray.loose.to_numpy()[: spray.count[None]])
    found = np.zeros((spray.count[None] * DROPLETS, 4), np.float32)
    read_droplets(spray, found)
    return found.reshape(-1, DROPLETS, 4)[order]


def volume(found: np.ndarray) -> float:
    return float((4.0 / 3.0 * np.pi * found[..., 3].astype(float) ** 3).sum())


@pytest.fixture
def surface(water):
    water.surface.reset()
    return water.surface


def test_patterns_are_balanced_and_equal():
    place, share = pattern()
    assert share.sum() == pytest.approx(1.0)
    assert np.abs(np.einsum("pki,k->pi", place, share)).max() < 1e-12
    assert np.linalg.norm(place, axis=2).max() <= 1.0
    assert np.array_equal(place, pattern()[0])


def test_lone_particles_become_droplets_of_their_volume(water, surface):
    """An image's mesh lacks lone particles, an exported mesh has them."""
    at_a_wall = (0.1, 0.4, 0.1 * FINE)  # regression: its image kept a third of it as a ball
    x = np.array([(0.1, 0.2, 0.1), (0.3, 0.4, 0.2), (0.5, FINE, 0.3), at_a_wall])
    water.fill(x)
    for _ in range(3):
        surface.advance(SPREADING)
        water.mesh(for_image=True)
    assert water.mesh(for_image=True).counts[1] == 0
    found = droplets(water)
    assert len(found) == len(x) and volume(found) == pytest.approx(len(x) * VOLUME, rel=1e-4)
    low, high = found[..., :3] - found[..., 3:], found[..., :3] + found[..., 3:]
    assert low.min() > -1e-6 and (high < np.array(SIZE) + 1e-6).all()
    assert water.mesh().volume() == pytest.approx(len(x) * VOLUME, rel=1e-3)


def test_a_frame_that_begins_again_keeps_its_spray(water, surface):
    """The kernels of an image are compiled in frames that begin again."""
    water.fill([(0.1, 0.2, 0.1), (0.3, 0.4, 0.2)])
    for _ in range(3):
        surface.advance(SPREADING)
        water.mesh(for_image=True)
    before, spray = droplets(water), surface.thin.spray
    kept = spray.frame, spray.elapsed
    water.mesh(for_image=True)
    spray.frame, spray.elapsed = kept
    water.mesh(for_image=True)
    assert np.abs(droplets(water) - before).max() < 1e-6


def test_still_water_has_no_spray(water, surface):
    water.fill(packed((0, 0, 0), (SIZE[0], 0.3, SIZE[2]), FINE, 0.05))
    exact = water.mesh().volume()
    assert water.mesh(for_image=True).volume() == pytest.approx(exact, rel=1e-6)
    assert surface.thin.spray.count[None] == 0


def test_droplets_move_continuously_while_a_particle_leaves_the_water_and_falls_back(
    water, surface
):
    """The particle moves by a third of a spacing, and its velocity reverses."""
    pool = packed((0, 0, 0), (SIZE[0], 0.15, SIZE[2]), FINE)
    up = np.arange(0.0, 5.0, 1.0 / 3.0)
    before, most = None, 0.0
    for n, rise in enumerate(np.concatenate([up, up[::-1], np.zeros(8)])):
        x = np.concatenate([[[0.31, 0.15 + (rise - 0.5) * FINE, 0.19]], pool]).astype(np.float32)
        v = np.zeros_like(x)
        v[0] = (0.5, 2.0 if n < len(up) else -2.0, 0.0)
        water.particles.fill(x=x, layer=np.zeros(len(x), np.int32), v=v)
        water.grid.build()
        surface.advance(FRAME)
        mesh = water.mesh(for_image=True)
        found = droplets(water)
        assert len(found) <= 1
        assert mesh.volume() + volume(found) == pytest.approx(water.volume, abs=0.5 * VOLUME)
        if before is not None and len(found) and len(before):
            assert np.linalg.norm((found - before)[..., :3], axis=2).max() < FINE
            change = abs(volume(found) - volume(before))
            assert change < 1.01 * FRAME / FADE * VOLUME
        before, most = found, max(most, volume(found))
    assert most > 0.9 * VOLUME
    assert len(found) == 0
