from dataclasses import replace

import numpy as np
import pytest
from surface_kit import (
    CELL,
    COARSE,
    FINE,
    SIZE,
    Water,
    as_trimesh,
    assert_same,
    middles,
    packed,
)

from msph.scene.observation import Surface
from msph.surface import SurfaceRoom

MIDDLE = np.array(SIZE) / 2


def waves(seed):
    """Returns a pool with waves, with the finer layer near its surface."""
    x = np.concatenate([packed((0, 0, 0), SIZE, d, 0.2, seed) for d in (FINE, COARSE)])
    layer = np.repeat([0, 1], [len(packed((0, 0, 0), SIZE, d)) for d in (FINE, COARSE)])
    level = 0.28 + 0.05 * np.sin(12 * x[:, 0] + seed) * np.cos(15 * x[:, 2])
    depth = level - x[:, 1]
    keep = (depth > 0) & (layer == (depth > 3 * FINE))
    return x[keep], layer[keep]


def bubbles(seed):
    """Returns a box full of water except for bubbles of 1 to 2.5 spacings radius, some at walls."""
    rng = np.random.default_rng(seed)
    x = packed((0, 0, 0), SIZE, FINE, 0.1, seed)
    centres = rng.uniform(0.0, SIZE, (12, 3))
    radius = rng.uniform(1.0, 2.5, 12) * FINE
    away = np.linalg.norm(x[:, None] - centres, axis=2) > radius
    return x[away.all(axis=1)], 0


def drops(seed):
    """Returns clumps of a few particles in the air, at the walls and in two corners."""
    rng = np.random.default_rng(seed)
    centres = np.concatenate([rng.uniform(0.0, SIZE, (25, 3)), [(0, 0, 0), SIZE]])
    clump = packed(MIDDLE - 2 * FINE, MIDDLE + 2 * FINE, FINE, 0.1, seed) - MIDDLE
    sizes = rng.uniform(0.8, 2.0, len(centres)) * FINE
    near = [clump[np.linalg.norm(clump, axis=1) < s] for s in sizes]
    x = np.concatenate([c + n for c, n in zip(centres, near, strict=True)])
    return np.clip(x, 1e-4, np.array(SIZE) - 1e-4), rng.integers(0, 2, len(x))


def splashes(seed):
    """Returns independent random particles without any order, sparse and dense."""
    rng = np.random.default_rng(seed)
    x = rng.uniform(0.0, SIZE, (4000, 3)) * rng.choice([0.6, 1.0], (4000, 1))
    return x, rng.integers(0, 2, len(x))


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("shape", [waves, bubbles, drops, splashes])
@pytest.mark.parametrize("kind", ["water", "smooth_water"])
def test_the_band_gives_the_same_mesh_as_the_whole_box(kind, shape, seed, request):
    water = request.getfixturevalue(kind)
    banded = middles(water.closed_mesh(*shape(seed)))
    full = middles(water.mesh(everywhere=True))
    assert len(full) > 100
    assert_same(full, banded)


def test_the_band_follows_the_surface_not_the_volume(water):
    """A small part of the box is evaluated for still water, and nothing without particles."""
    water.fill(packed((0, 0, 0), (SIZE[0], 0.35, SIZE[2]), FINE))
    water.mesh()
    pairs = [(n + 1) // 2 for n in water.surface.lattice.shape]
    state = water.surface.band.state.to_numpy()[: np.prod(pairs)]
    assert (state == 1).mean() < 0.2
    water.fill(np.zeros((0, 3)))
    assert water.mesh().counts.to_numpy().tolist() == [0, 0, 0, 0]
    assert water.surface.band.count[None] == 0


@pytest.mark.parametrize(("d", "layer"), [(FINE, 0), (COARSE, 1)])
def test_mesh_of_still_water_has_its_volume_and_flat_walls(water, d, layer):
    height = 0.3
    x = packed((0, 0, 0), (SIZE[0], height, SIZE[2]), d)
    mesh = water.closed_mesh(x, layer)
    vertices, normals, _ = mesh.to_numpy()
    # The lattice that fills the box is up to 4 % thinner or denser than water at rest, more than
    # the limited shift of the surface compensates.
    assert mesh.volume() == pytest.approx(water.volume, rel=0.025)
    assert vertices.min() == 0.0
    assert vertices[:, 0].max() == np.float32(SIZE[0])
    assert vertices[:, 2].max() == np.float32(SIZE[2])
    on_wall = (vertices == 0.0) | (vertices == np.float32(SIZE))
    assert (on_wall.sum(axis=1) <= 1).all()
    for axis in range(3):
        for plane, sign in ((0.0, -1.0), (np.float32(SIZE[axis]), 1.0)):
            assert (normals[vertices[:, axis] == plane, axis] == sign).all()
    free = ~on_wall.any(axis=1)
    assert normals[free, 1].min() > 0.98
    assert np.ptp(vertices[free, 1]) < 0.1 * d
    assert as_trimesh(mesh).euler_number == 2


def test_free_surface_reaches_the_walls(water):
    water.fill(packed((0, 0, 0), (SIZE[0], 0.3, SIZE[2]), FINE))
    vertices, _, _ = water.mesh().to_numpy()
    inset = 2 * water.surface.lattice.axes[0][1]
    top = vertices[vertices[:, 1] > 0.29]
    assert top[:, 0].min() <= inset and top[:, 0].max() >= np.float32(SIZE[0]) - inset


@pytest.mark.parametrize(("height", "most"), [(0.0, 1.0), (0.015, 3.0)])
def test_normals_of_a_level_surface_and_of_a_wave_are_accurate(smooth_water, height, most):
    """The rms angle to the exact normals is below `most` [deg] at the default smoothing.
    height: amplitude of the wave [m]."""
    scene_support, support = 2.45, 2.0  # of scenes and of these layers, in spacings
    smooth_water.surface.load(SIZE, CELL, Surface().smoothing * scene_support / support)
    k = 2 * np.pi / SIZE[0]
    x = packed((0, 0, 0), (SIZE[0], 0.3, SIZE[2]), FINE, 0.1)
    x[:, 1] *= 1.0 + height / 0.3 * np.cos(k * x[:, 0])
    smooth_water.fill(x)
    vertices, normals, _ = smooth_water.mesh().to_numpy()
    inner = (vertices > 1e-4).all(axis=1) & (vertices < np.array(SIZE) - 1e-4).all(axis=1)
    slope = -k * height * np.sin(k * vertices[inner, 0])
    exact = np.stack([-slope, np.ones_like(slope), np.zeros_like(slope)], axis=1)
    cosine = (normals[inner] * exact).sum(axis=1) / np.linalg.norm(exact, axis=1)
    angles = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
    assert np.sqrt((angles**2).mean()) < most


@pytest.mark.parametrize("centre", [MIDDLE, MIDDLE * [1, 1, 0], MIDDLE * [0, 1, 0]])
def test_a_ball_has_its_volume_also_where_walls_cut_it(water, centre):
    """A whole ball, half a ball at a wall and a quarter in an edge."""
    x, radius = packed((0, 0, 0), SIZE, FINE), 0.18
    mesh = water.closed_mesh(x[np.linalg.norm(x - centre, axis=1) < radius])
    assert mesh.volume() == pytest.approx(water.volume, rel=2e-3)


def test_mesh_of_a_full_box_has_the_volume_of_the_box(water):
    mesh = water.closed_mesh(packed((0, 0, 0), SIZE, FINE))
    assert mesh.volume() == pytest.approx(np.prod(SIZE), rel=1e-3)


def test_particles_beyond_walls_add_no_volume_and_no_drop(water):
    """The pipe of an inflow would raise the surface by 5 %; a jet is lone particles."""
    x = packed((0, 0, 0), (0.6, 0.3, 0.4), FINE)
    pipe = packed((0.2, 0, 0.1), (0.4, 3 * FINE, 0.3), FINE) - [0, 3 * FINE, 0]
    jet = np.array([[-0.1, 0.4, 0.2], [-0.2, 0.35, 0.2], [-0.2 * FINE, 0.38, 0.2]])
    mesh = water.closed_mesh(np.concatenate([x, pipe, jet]))
    assert mesh.volume() == pytest.approx(len(x) * FINE**3, rel=5e-3)
    assert as_trimesh(mesh).body_count == 1


def test_a_kernel_narrower_than_the_support_is_refused(water):
    with pytest.raises(ValueError, match="surface smoothing is 0.9"):
        water.surface.load(SIZE, 0.02, smoothing=0.9)


def test_a_scene_that_exceeds_the_room_is_refused(water):
    with pytest.raises(ValueError, match="room for 330,000 nodes, not for"):
        water.surface.load(SIZE, 0.006)


def test_one_surface_serves_all_scenes(water, compiled):
    """The surface compiles nothing, and its mesh is that of a surface built for the scene."""
    other, size = Water(), (0.63, 0.52, 0.4)
    for surface in (water.surface, other.surface):
        surface.load(size, 0.9 * CELL, 1.4)
    x, layer = waves(2)
    other.fill(x, layer)
    fresh = middles(other.mesh())
    water.fill(x, layer)
    water.surface.load(SIZE, CELL)
    first = middles(water.mesh())
    compiled.clear()
    water.surface.load(size, 0.9 * CELL, 1.4)
    assert_same(fresh, middles(water.mesh()))
    water.surface.load(SIZE, CELL)
    assert_same(first, middles(water.mesh()))
    assert compiled == []
    other.simulation.close()


def test_capacities_of_a_room_grow_separately():
    """The memory of a room is known before its allocation."""
    first = SurfaceRoom()
    assert SurfaceRoom.holding((1.0, 1.0, 1.0), 0.05, 1000) == first
    many = SurfaceRoom.holding((1.0, 1.0, 1.0), 0.05, 40_000)
    assert many == replace(first, particles=4 * first.particles)
    large = SurfaceRoom.holding((1.0, 1.0, 1.0), 0.01, 1000)
    assert large.nodes == 4 * first.nodes and large.particles == first.particles
    assert first.bytes < many.bytes < large.bytes < 5 * first.bytes
