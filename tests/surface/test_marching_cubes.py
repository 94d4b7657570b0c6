import numpy as np
import pytest
from surface_kit import Cubes, as_trimesh, assert_closed, uniform

from msph.surface import SurfaceRoom
from msph.surface.marching_cubes import MarchingCubes


def walled_in(value: np.ndarray) -> np.ndarray:
    """Returns the field with all border nodes outside the surface."""
    closed = np.full_like(value, -1.0)
    closed[1:-1, 1:-1, 1:-1] = value[1:-1, 1:-1, 1:-1]
    return closed


@pytest.mark.parametrize("seed", range(3))
def test_random_fields_give_closed_manifolds(oblong_cubes, seed):
    """White noise contains every case and every ambiguous neighbourhood; zeros count as outside."""
    rng, shape = np.random.default_rng(seed), oblong_cubes.lattice.shape
    for values in (rng.normal(size=shape), rng.integers(-1, 2, shape).astype(float)):
        mesh = oblong_cubes.extract(walled_in(values))
        assert mesh.counts[1] > 10_000
        assert_closed(mesh)


def test_no_triangle_is_degenerate(oblong_cubes):
    values = np.random.default_rng(1).choice([-1.0, -1e-6, 1e-6, 1.0], oblong_cubes.lattice.shape)
    mesh = oblong_cubes.extract(walled_in(values))
    assert as_trimesh(mesh).area_faces.min() > 0.0


def test_sphere_area_and_volume_converge_with_second_order(cubes):
    x = cubes.nodes()
    radii = np.array([4.7, 9.4, 18.8])
    errors = []
    for r in radii:
        mesh = cubes.extract(r * r - (x**2).sum(axis=0), -2.0 * x)
        assert_closed(mesh)
        area, volume, solid = 4 * np.pi * r**2, 4 / 3 * np.pi * r**3, as_trimesh(mesh)
        errors.append((abs(solid.area / area - 1), abs(mesh.volume() / volume - 1)))
        assert mesh.volume() == pytest.approx(solid.volume, rel=1e-6)
    order = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert (order > 1.7).all() and (order < 2.3).all()
    assert max(errors[-1]) < 3e-3


def test_normals_of_a_sphere_are_radial(cubes):
    x = cubes.nodes()
    r = np.linalg.norm(x, axis=0)
    vertices, normals, _ = cubes.extract(15.0 - r, -x / r).to_numpy()
    exact = vertices / np.linalg.norm(vertices, axis=1, keepdims=True)
    assert np.allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-5)
    assert (normals * exact).sum(axis=1).min() > 0.9995


def test_normals_without_gradient_follow_the_edge(cubes):
    _, normals, _ = cubes.extract(10.0 - np.linalg.norm(cubes.nodes(), axis=0)).to_numpy()
    assert np.allclose(np.abs(normals).max(axis=1), 1.0, atol=1e-6)


def test_an_ellipsoid_has_its_volume_on_an_anisotropic_lattice(oblong_cubes):
    x, y, z = oblong_cubes.nodes()
    a, b, c = 1.2, 1.3, 1.1
    mesh = oblong_cubes.extract(1.0 - (x / a) ** 2 - (y / b) ** 2 - (z / c) ** 2)
    assert_closed(mesh)
    assert as_trimesh(mesh).euler_number == 2
    assert mesh.volume() == pytest.approx(4 / 3 * np.pi * a * b * c, rel=0.01)


def test_torus_has_a_hole(cubes):
    x, y, z = cubes.nodes()
    mesh = cubes.extract(5.0 - np.hypot(np.hypot(x, y) - 12.0, z))
    assert_closed(mesh)
    assert as_trimesh(mesh).euler_number == 0
    assert mesh.volume() == pytest.approx(2 * np.pi**2 * 12.0 * 5.0**2, rel=0.01)


def test_empty_field_gives_an_empty_mesh(cubes):
    mesh = cubes.extract(-np.ones(cubes.lattice.shape))
    assert mesh.counts.to_numpy().tolist() == [0, 0, 0, 0]
    assert as_trimesh(mesh).area == 0.0 and mesh.volume() == 0.0


@pytest.mark.parametrize("nodes", [31, 32, 33, 64])
def test_rows_may_end_anywhere_in_a_word_of_signs(marching_cubes, nodes):
    """There is one vertex for each edge whose ends differ in sign, and none beyond the lattice."""
    cubes = Cubes(uniform((5, 4, nodes)), marching_cubes)
    noise = np.random.default_rng(nodes).normal(size=cubes.lattice.shape)
    for value in (noise, walled_in(noise)):
        inside = value > 0.0
        crossed = sum(int(np.diff(inside, axis=a).sum()) for a in range(3))
        assert cubes.extract(value).counts[2] == crossed
    assert_closed(marching_cubes.mesh)


@pytest.mark.parametrize("capacity", [(500, 100_000), (50_000, 500)])
def test_overflow_is_reported_and_the_partial_mesh_is_valid(capacity):
    vertices, triangles = capacity
    room = SurfaceRoom(vertices=vertices, triangles=triangles)
    small = Cubes(uniform((18, 18, 18)), MarchingCubes(room))
    noise = np.random.default_rng(5).normal(size=(18, 18, 18))
    mesh = small.extract(walled_in(noise))
    vertices, normals, triangles = mesh.to_numpy()
    assert len(vertices) <= capacity[0] and 0 < len(triangles) <= capacity[1]
    assert triangles.min() >= 0 and triangles.max() < len(vertices)
    assert np.isfinite(vertices).all() and np.allclose(np.linalg.norm(normals, axis=1), 1.0, 1e-4)
    assert np.unique(np.sort(triangles, axis=1), axis=0).shape == triangles.shape
    report = mesh.overflowed()
    name = "vertices" if capacity[0] == 500 else "triangles"
    assert name in report and "500 fit" in report
    assert small.extract(-np.ones_like(noise)).overflowed() is None
