"""Resolution: gaps, bodies and depths of shapes that are known."""

import numpy as np
import pytest

from msph.measure.resolution import mean_depth, narrowest_gap, resolution
from msph.scene import load_scene
from msph.scene.build import plan_of
from tests.scenes_kit import write

SCENE = """
[box]
size = [1.0, 0.8, 0.6]
[[layers]]
spacing = 0.02
[[layers]]
spacing = 0.04
[[water]]
lo = [0, 0, 0]
hi = [0.1, 0.2, 0.3]
"""
BALLS = """
[[bodies]]
centre = [0.4, 0.4, 0.3]
radius = 0.1
[[bodies]]
centre = [0.7, 0.4, 0.3]
radius = 0.12
"""
PLATE = """
[[bodies]]
lo = [0.5, 0, 0]
hi = [0.53, 0.5, 0.54]
"""


def scene(tmp_path, bodies=""):
    return load_scene(write(tmp_path, SCENE + bodies))


def test_without_bodies_the_gap_is_the_boxs_shortest_edge(tmp_path):
    found = resolution(plan_of(scene(tmp_path)), depth=0.3)
    assert found["spacings_across_narrowest_gap"] == pytest.approx(30.0)
    assert found["spacings_across_depth"] == pytest.approx(15.0)
    assert found["finest_spacing_m"] == pytest.approx(0.02)
    assert found["coarsest_spacing_m"] == pytest.approx(0.04)


def test_between_two_balls(tmp_path):
    found = resolution(plan_of(scene(tmp_path, BALLS)))
    assert found["spacings_across_narrowest_gap"] == pytest.approx(0.08 / 0.02, rel=0.05)
    assert found["spacings_across_bodies.0"] == pytest.approx(0.2 / 0.02)


def test_between_a_plate_and_a_wall_that_it_does_not_touch(tmp_path):
    """It stands on the floor and against z = 0, which is no gap, and leaves .06 m at z = .6."""
    found = resolution(plan_of(scene(tmp_path, PLATE)))
    assert found["spacings_across_narrowest_gap"] == pytest.approx(0.06 / 0.02)
    assert found["spacings_across_bodies.0"] == pytest.approx(0.03 / 0.02)


def test_a_rings_thickness_is_that_of_its_tube():
    """Whichever way it is turned; and a container's room is its inside."""
    ring = load_scene("paddle")
    flat = ring.bodies[1].model_copy(update={"rotation": (0.0, 0.0, 0.0)})
    plain = ring.model_copy(update={"bodies": [ring.bodies[0], flat]})
    key = "spacings_across_bodies.1"
    turned, straight = resolution(plan_of(ring))[key], resolution(plan_of(plain))[key]
    assert turned == pytest.approx(straight, rel=1e-3)
    bowl = load_scene("bowl")
    height = resolution(plan_of(bowl))["spacings_across_narrowest_gap"] * bowl.layers[0].spacing
    assert 0.2 < height < 0.6


def test_no_gap_is_seen_where_bodies_touch():
    assert narrowest_gap((1.0, 1.0, 0.5), [], 0.1) == 0.5


def test_mean_depth_is_twice_the_centres_height(tmp_path):
    centres = np.array([[0.5, 0.1, 0.3], [0.5, 0.2, 0.3]])
    plan = plan_of(scene(tmp_path))
    assert mean_depth((0.0, -9.81, 0.0), plan, centres) == pytest.approx(0.3)
    assert mean_depth((0.0, 9.81, 0.0), plan, centres) == pytest.approx(2 * (0.8 - 0.15))
    assert np.isnan(mean_depth((0.0, 0.0, 0.0), plan, centres))
