"""The quality ladder: what it changes, where it is refused, and how a machine chooses."""

import itertools

import numpy as np
import pytest

from msph.scene import SceneError, load_scene
from msph.scene.library import shipped_scenes
from msph.scene.quality import AS_GIVEN, LADDER, Quality, at_quality, choose, costs, estimate
from msph.scene.water import asked_mass, layer_specs


@pytest.fixture(scope="module")
def dam_break():
    return load_scene("dam_break")


def test_the_command_line_offers_what_the_ladder_has():
    from msph.cli import QUALITIES
    from msph.scene.quality import NAMES

    assert QUALITIES == NAMES


@pytest.mark.parametrize("name", ["dam_break", "pool", "bowl"])
def test_steps_halve_the_volume_of_particles_and_keep_the_water(name):
    scene = load_scene(name)
    sizes = [np.array([s.volume for s in layer_specs(at_quality(scene, q, name))]) for q in LADDER]
    for coarse, fine in itertools.pairwise(sizes):
        assert coarse / fine == pytest.approx(2.0)
    masses = [asked_mass(at_quality(scene, q, name)) for q in LADDER]
    assert masses == pytest.approx([asked_mass(scene)] * len(LADDER))


def test_large_is_the_scene_as_it_is_written(dam_break):
    assert at_quality(dam_break, AS_GIVEN, "dam_break") is dam_break


@pytest.mark.parametrize("name", ["motion_tolerance", "cfl"])
def test_a_solvers_setting_that_the_scene_gives_stays(name):
    given = load_scene("dam_break", (f"projection.{name}=0.2",))
    assert getattr(at_quality(given, "small", "dam_break").projection, name) == 0.2
    own = at_quality(load_scene("dam_break"), "small", "dam_break")
    assert getattr(own.projection, name) == getattr(LADDER["small"], name)


def test_the_ladders_defaults_are_the_scenes():
    own = load_scene("dam_break").projection
    assert LADDER[AS_GIVEN] == Quality(1.0, own.motion_tolerance, own.cfl)


@pytest.mark.parametrize("variant", ["system-1", "system-3"])
def test_exact_numbers_of_particles_have_one_quality(variant):
    scene = load_scene("pool", (f"variant={variant}",))
    with pytest.raises(SceneError, match="pool: --quality: it has one quality, large"):
        at_quality(scene, "small", "pool")
    assert choose(scene, "", 1.0) == AS_GIVEN


def test_classic_water_has_one_quality():
    scene = load_scene("pool", ("variant=system-1", "method=classic"))
    with pytest.raises(SceneError, match="one quality"):
        at_quality(scene, "finest", "pool")


def test_faster_machines_choose_finer_water(dam_break):
    speeds = np.geomspace(1e6, 1e13, 60)
    chosen = [list(LADDER).index(choose(dam_break, "dam_break", s)) for s in speeds]
    assert chosen == sorted(chosen)
    assert {chosen[0], chosen[-1]} == {0, len(LADDER) - 1}


def test_a_display_that_takes_the_cores_leaves_less_for_water(dam_break):
    """Water of medium quality ran at x.81 beside a display that was drawn by the same two cores."""
    # In steps of .3 %: the display takes 2 % of the time or more.
    speeds = np.geomspace(1e8, 1e12, 3000)
    fits = next(s for s in speeds if choose(dam_break, "", s) == "large")
    assert choose(dam_break, "", fits, display=0.001) == "medium"
    assert choose(dam_break, "", 2.0 * fits, display=0.01) == "large"
    assert choose(dam_break, "", 1e13, display=1.0) == next(iter(LADDER))


def test_finer_water_costs_more_and_errs_less():
    """Of what was measured, for every shipped scene."""
    for name in shipped_scenes():
        known = costs(name)
        assert list(known) == list(LADDER), name
        particles = [c.particles for c in known.values()]
        assert particles == sorted(particles), name
        assert known["finest"].error < known["small"].error + 1e-3, name


def test_only_what_changes_the_water_makes_another_scene(dam_break):
    """A scene is looked up by its water: another view costs the same, more water does not."""
    speed = 1e10  # fast enough for the finest dam break that was measured
    view = load_scene("dam_break", ("picture.view=layers", "play.push_grip=5.0"))
    assert choose(view, "dam_break", speed) == choose(dam_break, "dam_break", speed)
    large = load_scene("dam_break", ("box.size=[4.8, 2.7, 0.6]", "water.0.hi=[1.2, 2.4, 0.6]"))
    assert choose(large, "dam_break", speed) == next(iter(LADDER))


@pytest.mark.parametrize("name", shipped_scenes())
def test_a_scene_that_was_not_measured_is_estimated(name):
    """Within a factor of 8: calm water is taken as violent, and splashes grow more surface."""
    scene = load_scene(name)
    found = [estimate(scene, quality) for quality in LADDER]
    assert found == sorted(found)
    assert 0.2 < estimate(scene, AS_GIVEN) / costs(name)[AS_GIVEN].dearest < 8.0
