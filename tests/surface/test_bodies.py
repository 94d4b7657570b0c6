import numpy as np
import pytest
from surface_kit import FINE, SIZE, Water, assert_closed, assert_same, middles, packed

from msph.fluid.boundary.rigid_bodies import Ball
from msph.surface.surface import OVERLAP


def filled(water, level: float) -> np.ndarray:
    x = packed((0, 0, 0), SIZE, FINE, 0.1)
    return x[water.boundary.free(x) & (x[:, 1] < level)]


@pytest.mark.parametrize("level", [0.15, 0.25, 0.35])
def test_the_surface_ends_on_bodies_and_encloses_the_water(held_water, level):
    """Ball and block in a container, under water and through its surface."""
    held_water.fill(filled(held_water, level))
    mesh = held_water.mesh()
    assert_closed(mesh)
    assert mesh.volume() == pytest.approx(held_water.volume, rel=0.01)
    vertices = mesh.to_numpy()[0]
    free = held_water.boundary.free
    assert free(vertices, -0.2 * FINE).all()  # cells cut edges
    # All round the ball, and on the container: no air between water and bodies.
    near = vertices[~free(vertices, 0.05 * FINE)]
    ball = held_water.boundary.bodies[1]
    at_ball = near[np.linalg.norm(near - ball.centre, axis=1) < ball.radius + 0.1 * FINE]
    under = level - 3 * FINE
    assert at_ball[:, 1].min() < ball.centre[1] - 0.9 * ball.radius
    assert at_ball[:, 1].max() > min(ball.centre[1] + 0.9 * ball.radius, under)
    assert (vertices[:, 1] < under).sum() == pytest.approx((near[:, 1] < under).sum(), rel=0.06)


def test_the_band_gives_the_same_mesh_beside_bodies(held_water):
    held_water.fill(filled(held_water, 0.25))
    banded = middles(held_water.mesh())
    assert_same(middles(held_water.mesh(everywhere=True)), banded)


def test_a_mesh_for_an_image_reaches_into_bodies():
    """The waterline had steps of a cell. The volume control does not see what bodies hide."""
    water = Water(bodies=[Ball(np.array((0.2, 0.2, 0.2)), 0.08)])
    water.fill(filled(water, 0.25))
    exact, shift = middles(water.mesh()), water.surface.volume_control.shift[None]
    water.surface.extract(hidden=True)
    assert_closed(water.surface.mesh)
    assert water.surface.volume_control.shift[None] == pytest.approx(shift, abs=1e-5)
    radii = np.linalg.norm(water.surface.mesh.to_numpy()[0] - (0.2, 0.2, 0.2), axis=1)
    assert 0.08 - radii.min() == pytest.approx(OVERLAP * FINE, abs=0.15 * FINE)
    assert_same(middles(water.mesh()), exact)
    water.simulation.close()
