import numpy as np
import pytest
from surface_kit import FINE, SIZE, Water, as_trimesh, assert_closed, assert_same, middles, packed

from msph.fluid.boundary.rigid_bodies import Ball, Block

CENTRE, RADIUS = np.array((0.2, 0.2, 0.2)), 0.08


def filled(water, level: float) -> np.ndarray:
    x = packed((0, 0, 0), SIZE, FINE, 0.1)
    return x[water.boundary.free(x) & (x[:, 1] < level)]


# These two tests come first: `held_water` then uses the fields and kernels that they give back.
def test_a_mesh_for_an_image_reaches_into_bodies():
    """Regression: the waterline had steps of a cell."""
    water = Water(bodies=[Ball(CENTRE, RADIUS)])
    water.fill(filled(water, 0.25))
    exact, shift = middles(water.mesh()), water.surface.volume_control.shift[None]
    water.mesh(for_image=True)
    assert_closed(water.surface.mesh)
    assert water.surface.volume_control.shift[None] == pytest.approx(shift, abs=1e-5)
    solid = as_trimesh(water.surface.mesh)
    radii = np.linalg.norm(solid.vertices - CENTRE, axis=1)
    cell = np.array(water.surface.lattice.spacing)
    assert RADIUS - radii.min() == pytest.approx(np.linalg.norm(cell), abs=0.2 * cell.max())
    # Regression: faces at the bevelled end of the mesh met the ball and notched the waterline.
    inner = (radii < RADIUS)[solid.faces]
    at_side = solid.face_normals[inner.any(axis=1) & ~inner.all(axis=1)]
    assert len(at_side) > 20 and at_side[:, 1].min() > 0.3
    assert_same(middles(water.mesh()), exact)
    water.simulation.close()


def test_a_mesh_for_an_image_does_not_pass_through_a_thin_body():
    thickness = 1.5 * FINE
    half = 0.5 * np.array((thickness, 1.0, 1.0))
    middle = np.array((0.4, 0.5, 0.2))
    water = Water(bodies=[Block(middle - half, middle + half)])
    x = filled(water, 0.25)
    water.fill(x[x[:, 0] < middle[0]])
    water.mesh(for_image=True)
    assert_closed(water.surface.mesh)
    # Interpolation across the body's middle, where its distance has a kink, is off by up to 2 %.
    assert water.surface.mesh.to_numpy()[0][:, 0].max() < middle[0] + 0.03 * thickness
    water.simulation.close()


@pytest.mark.parametrize("level", [0.15, 0.25, 0.35])
def test_the_surface_ends_on_bodies_and_encloses_the_water(held_water, level):
    """The container holds a ball and a block, which are submerged or pierce the surface."""
    mesh = held_water.closed_mesh(filled(held_water, level))
    assert mesh.volume() == pytest.approx(held_water.volume, rel=0.01)
    vertices = mesh.to_numpy()[0]
    free = held_water.boundary.free
    assert free(vertices, -0.2 * FINE).all()  # cells bevel edges
    # The mesh lies on the whole ball and the container, with no air between water and bodies.
    near = vertices[~free(vertices, 0.05 * FINE)]
    ball = held_water.boundary.bodies[1]
    at_ball = near[np.linalg.norm(near - ball.centre, axis=1) < ball.radius + 0.1 * FINE]
    under = level - 3 * FINE
    assert at_ball[:, 1].min() < ball.centre[1] - 0.9 * ball.radius
    assert at_ball[:, 1].max() > min(ball.centre[1] + 0.9 * ball.radius, under)
    assert (vertices[:, 1] < under).sum() == pytest.approx((near[:, 1] < under).sum(), rel=0.06)


def test_the_band_gives_the_same_mesh_next_to_bodies(held_water):
    held_water.fill(filled(held_water, 0.25))
    banded = middles(held_water.mesh())
    assert_same(middles(held_water.mesh(everywhere=True)), banded)
