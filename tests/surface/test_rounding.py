"""Tests of rounding: strongly curved parts of the mesh are smoother, all others are unchanged."""

import numpy as np
import pytest
from surface_kit import FINE, SIZE, Water, as_trimesh, assert_closed, packed

from msph.surface import SurfaceRoom
from msph.surface.rounding import ON_WALL


def pairs(seed: int) -> np.ndarray:
    """Returns pairs of particles 1.2 spacings apart, in random directions and far from others."""
    rng = np.random.default_rng(seed)
    x = packed((0.09, 0.09, 0.09), np.array(SIZE) - 0.09, 6 * FINE)
    half = rng.normal(size=x.shape)
    half *= 0.6 * FINE / np.linalg.norm(half, axis=1, keepdims=True)
    x = x + rng.uniform(-0.5, 0.5, x.shape) * FINE
    return np.concatenate([x - half, x + half])


def without_rounding(water, monkeypatch):
    """Returns the mesh of the present particles as marching cubes and drops make it."""
    with monkeypatch.context() as patch:
        patch.setattr(water.surface.rounding, "round", lambda bodies: None)
        return as_trimesh(water.mesh())


def turns(mesh) -> float:
    """Returns the angle between adjacent faces, weighted by the lengths of their edges [rad]."""
    ends = mesh.vertices[mesh.face_adjacency_edges]
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    return float(np.average(mesh.face_adjacency_angles, weights=lengths))


def test_pairs_of_particles_are_smoother_at_the_same_volume(water, monkeypatch):
    for seed in range(2):
        water.fill(pairs(seed))
        rough = without_rounding(water, monkeypatch)
        mesh = water.mesh()
        assert_closed(mesh)
        smooth = as_trimesh(mesh)
        assert len(smooth.split()) == len(rough.split())
        assert turns(smooth) < 0.7 * turns(rough)
        assert smooth.volume == pytest.approx(rough.volume, rel=0.01)


def test_normals_of_rounded_meshes_are_unit_vectors_out_of_the_water(water):
    water.fill(pairs(2))
    vertices, normals, triangles = water.mesh().to_numpy()
    assert np.linalg.norm(normals, axis=1) == pytest.approx(1.0, abs=1e-5)
    a, b, c = vertices[triangles].transpose(1, 0, 2)
    faces = np.cross(b - a, c - a)
    outwards = np.einsum("ti,ti->t", faces, normals[triangles].mean(axis=1))
    assert (outwards > 0.0).mean() > 0.99


def test_still_water_and_its_edges_at_walls_are_unchanged(water, monkeypatch):
    water.fill(packed((0, 0, 0), (SIZE[0], 0.2, SIZE[2]), FINE))
    before = without_rounding(water, monkeypatch)
    after = as_trimesh(water.mesh())
    assert water.surface.rounding.numbers.found[None] == 0
    assert np.array_equal(before.faces, after.faces)
    assert after.vertices == pytest.approx(before.vertices, abs=1e-7)


def test_vertices_on_walls_stay_and_none_leave_the_box(water, monkeypatch):
    """The lowest pairs touch the floor, where the mesh is flat."""
    x = pairs(3)
    x[:, 1] *= 0.02
    water.fill(x)
    rough, smooth = without_rounding(water, monkeypatch), as_trimesh(water.mesh())
    assert_closed(water.surface.mesh)
    assert water.surface.rounding.numbers.found[None] > 20
    assert smooth.vertices.min() >= 0.0 and (np.array(SIZE) - smooth.vertices).min() >= -1e-7
    on_floor = rough.vertices[rough.vertices[:, 1] < ON_WALL * max(SIZE)]
    away = np.linalg.norm(on_floor[:, None] - smooth.vertices, axis=2).min(axis=1)
    assert len(on_floor) > 20 and away.max() < 1e-6


@pytest.mark.slow
def test_a_mesh_without_room_for_all_divided_edges_stays_as_it_is(water, monkeypatch):
    water.fill(pairs(4))
    rough = without_rounding(water, monkeypatch)
    room = SurfaceRoom(vertices=len(rough.vertices) + 9, triangles=3 * len(rough.faces))
    small = Water(room=room)
    mesh = small.closed_mesh(pairs(4))
    numbers = small.surface.rounding.numbers
    assert numbers.found[None] > 9 and numbers.divided[None] == 0
    same = as_trimesh(mesh)
    assert np.array_equal(same.faces, rough.faces)
    assert same.vertices == pytest.approx(rough.vertices, abs=1e-7)
    small.simulation.close()
