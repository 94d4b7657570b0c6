import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree
from surface_kit import FINE, SIZE, Water, as_trimesh, packed

from msph.surface import SurfaceRoom

VOLUME = FINE**3


def apart(seed: int) -> np.ndarray:
    """Returns particles at least five spacings apart, each at a random place within its cell."""
    rng = np.random.default_rng(seed)
    x = packed((0.06, 0.06, 0.06), np.array(SIZE) - 0.06, 6 * FINE)
    return x + rng.uniform(-0.5, 0.5, x.shape) * FINE


def test_drops_are_round_and_have_their_volume(water):
    """Regression: drops were polyhedra whose distances from the centre varied by 13 %."""
    for seed in range(2):
        x = apart(seed)
        mesh = water.closed_mesh(x)
        drops = as_trimesh(mesh).split()
        assert len(drops) == len(x)
        for drop in drops:
            distance, own = cKDTree(x).query(drop.center_mass)
            assert distance < 1e-3 * FINE
            assert drop.volume == pytest.approx(VOLUME, rel=1e-3)
            points = trimesh.sample.sample_surface(drop, 500, seed=1)[0]
            radii = np.linalg.norm(points - x[own], axis=1)
            assert radii.std() < 0.03 * radii.mean()


def test_drops_on_walls_are_round(water):
    """Regression: drops on walls were flat octagons."""
    beside = 0.4 * FINE
    x = np.array([(beside, 0.2, 0.2), (0.3, beside, 0.1), (0.5, 0.3, SIZE[2] - beside)])
    drops = as_trimesh(water.closed_mesh(x)).split()
    assert len(drops) == len(x)
    for drop in drops:
        assert (drop.bounds[0] > -1e-6).all() and (drop.bounds[1] < np.array(SIZE) + 1e-6).all()
        assert drop.volume == pytest.approx(VOLUME, rel=1e-3)
        assert drop.extents.std() < 0.03 * drop.extents.mean()


@pytest.mark.slow
def test_drops_that_exceed_the_room_are_reported():
    room = SurfaceRoom(vertices=100, triangles=300)
    small = Water(room=room)
    small.fill(apart(0))
    mesh = small.mesh()
    # Two whole drops of 42 vertices and 80 triangles fit.
    assert list(mesh.counts.to_numpy()[:2]) == [84, 160]
    assert mesh.overflowed().startswith("surface mesh overflow: ")
    small.simulation.close()


@pytest.mark.parametrize("height", np.array([0.2, 0.2075, 0.2142]))
def test_a_sheet_one_particle_thick_keeps_its_volume_and_has_no_hole(water, height):
    x = packed((0, 0, 0), (SIZE[0], FINE, SIZE[2]), FINE, 0.05)
    x[:, 1] += height
    mesh = water.closed_mesh(x)
    assert as_trimesh(mesh).euler_number == 2
    assert mesh.volume() == pytest.approx(water.volume, rel=0.01)
    assert abs(water.surface.volume_control.shift[None]) < 0.06


@pytest.mark.parametrize("seed", range(3))
def test_a_sheet_of_irregular_particles_is_a_film_without_holes(smooth_water, seed):
    """Regression: the film had three holes: kernels were as narrow along a sheet as across it."""
    x = packed((0, 0, 0), (SIZE[0], FINE, SIZE[2]), FINE)
    x[:, 1] += 0.2
    x += np.random.default_rng(seed).normal(0.0, 0.15 * FINE, x.shape)
    mesh = smooth_water.closed_mesh(np.clip(x, 0.1 * FINE, np.array(SIZE) - 0.1 * FINE))
    assert as_trimesh(mesh).euler_number == 2
    assert mesh.volume() == pytest.approx(smooth_water.volume, rel=0.01)


def test_the_mesh_changes_continuously_while_a_particle_leaves_the_water(water):
    """The particle rises by 0.1 spacings at a time."""
    pool = packed((0, 0, 0), (SIZE[0], 0.15, SIZE[2]), FINE)
    last = None
    for rise in np.arange(0.0, 4.0, 0.1):
        leaving = [[0.31, 0.15 + (rise - 0.5) * FINE, 0.19]]
        water.fill(np.concatenate([pool, leaving]))
        mesh = water.mesh()
        assert mesh.volume() == pytest.approx(water.volume, abs=0.5 * VOLUME)
        vertices = mesh.to_numpy()[0]
        if last is not None:
            ways = cKDTree(last).query(vertices)[0], cKDTree(vertices).query(last)[0]
            assert max(way.max() for way in ways) < FINE
        last = vertices
    assert vertices[:, 1].max() > 0.15 + 3.5 * FINE


def test_still_water_keeps_the_kernels_of_full_reach(water):
    """Where water is not thin, its surface is as smooth as with the widest kernels."""
    water.fill(packed((0, 0, 0), (SIZE[0], 0.3, SIZE[2]), FINE, 0.05))
    water.mesh()
    thin = water.surface.thin
    per_r2 = thin.kernel.to_numpy()[: water.particles.count, 0]
    assert np.allclose(per_r2, 1.0 / thin.by_layer.reach[0] ** 2, rtol=1e-5)
