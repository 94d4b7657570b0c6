"""Tests of the resolution: gaps, bodies and depths of known shapes."""

import numpy as np
import pytest

from msph.measure.resolution import mean_depth, narrowest_gap, resolution
from msph.scene import load_scene
from msph.scene.build import plan_of
from tests.scenes_kit import load

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


@pytest.mark.parametrize(
    ("bodies", "gap", "across"),
    [
        ("", 0.6, None),  # the shortest edge of the box
        (BALLS, 0.08, 0.2),  # between the balls
        # The plate touches the floor and the wall z = 0: the gap is at the wall z = 0.6 m.
        (PLATE, 0.06, 0.03),
    ],
)
def test_resolution_is_over_the_finest_spacing(tmp_path, bodies, gap, across):
    found = resolution(plan_of(load(tmp_path, SCENE + bodies)), depth=0.3)
    assert found["spacings_across_narrowest_gap"] == pytest.approx(gap / 0.02, rel=0.05)
    if across:
        assert found["spacings_across_bodies.0"] == pytest.approx(across / 0.02)
    assert found["spacings_across_depth"] == pytest.approx(15.0)
    assert found["finest_spacing_m"] == pytest.approx(0.02)
    assert found["coarsest_spacing_m"] == pytest.approx(0.04)


def test_thickness_of_a_ring_is_the_thickness_of_its_tube():
    """The resolution across a ring does not depend on its rotation, and the narrowest gap of a
    container is measured inside it."""
    ring = load_scene("paddle")
    flat = ring.bodies[1].model_copy(update={"rotation": (0.0, 0.0, 0.0)})
    plain = ring.model_copy(update={"bodies": [ring.bodies[0], flat]})
    key = "spacings_across_bodies.1"
    turned, straight = resolution(plan_of(ring))[key], resolution(plan_of(plain))[key]
    assert turned == pytest.approx(straight, rel=1e-3)
    bowl = load_scene("bowl")
    height = resolution(plan_of(bowl))["spacings_across_narrowest_gap"] * bowl.layers[0].spacing
    assert 0.2 < height < 0.6


def test_balls_that_touch_have_no_gap_between_them(tmp_path):
    """Of balls that touch, the narrowest gap is that to a wall; a spacing of 0 counts any gap."""
    touching = load(tmp_path, SCENE + BALLS.replace("0.7, 0.4", "0.62, 0.4"))
    bodies = plan_of(touching).bodies
    assert narrowest_gap((1.0, 0.8, 0.6), bodies, 0.02) == pytest.approx(0.6 - 0.3 - 0.12)
    assert narrowest_gap((1.0, 0.8, 0.6), bodies, 0.0) < 0.01


def test_mean_depth_is_twice_the_centres_height(tmp_path):
    centres = np.array([[0.5, 0.1, 0.3], [0.5, 0.2, 0.3]])
    plan = plan_of(load(tmp_path, SCENE))
    assert mean_depth((0.0, -9.81, 0.0), plan, centres) == pytest.approx(0.3)
    assert mean_depth((0.0, 9.81, 0.0), plan, centres) == pytest.approx(2 * (0.8 - 0.15))
    assert np.isnan(mean_depth((0.0, 0.0, 0.0), plan, centres))
