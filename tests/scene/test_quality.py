"""Tests of the quality ladder: what each quality changes, and scenes with only one quality."""

import itertools

import numpy as np
import pytest

from msph.options import AS_GIVEN
from msph.scene import SceneError, load_scene
from msph.scene.library import shipped_scenes
from msph.scene.quality import LADDER, Quality, at_quality, costs
from msph.scene.water import layer_specs, specified_mass


def asked(scene):
    return specified_mass(scene, layer_specs(scene))


@pytest.mark.parametrize("name", ["dam_break", "pool", "bowl"])
def test_each_quality_halves_the_particle_volume_and_keeps_the_mass(name):
    scene = load_scene(name)
    sizes = [np.array([s.volume for s in layer_specs(at_quality(scene, q, name))]) for q in LADDER]
    for coarse, fine in itertools.pairwise(sizes):
        assert coarse / fine == pytest.approx(2.0)
    masses = [asked(at_quality(scene, q, name)) for q in LADDER]
    assert masses == pytest.approx([asked(scene)] * len(LADDER))


def test_large_quality_is_the_unchanged_scene_with_the_default_solver_settings():
    scene = load_scene("dam_break")
    assert at_quality(scene, AS_GIVEN, "dam_break") is scene
    own = scene.projection
    assert LADDER[AS_GIVEN] == Quality(1.0, own.motion_tolerance, own.cfl)


@pytest.mark.parametrize("name", ["motion_tolerance", "cfl"])
def test_solver_settings_given_by_the_scene_are_kept(name):
    given = load_scene("dam_break", (f"projection.{name}=0.2",))
    assert getattr(at_quality(given, "small", "dam_break").projection, name) == 0.2
    own = at_quality(load_scene("dam_break"), "small", "dam_break")
    assert getattr(own.projection, name) == getattr(LADDER["small"], name)


@pytest.mark.parametrize("system", [1, 3])
@pytest.mark.parametrize("method", ["classic", "projection"])
def test_scenes_with_given_particle_numbers_have_one_quality(system, method):
    changes = (f"variant=system-{system}", f"method={method}")
    with pytest.raises(SceneError, match="pool: --quality: has only the quality large"):
        at_quality(load_scene("pool", changes), "small", "pool")


def test_finer_qualities_have_more_particles_and_smaller_errors():
    """The error of `finest` is less than the error of `small`, up to 0.001."""
    for name in shipped_scenes():
        known = costs(name)
        assert list(known) == list(LADDER), name
        particles = [c.particles for c in known.values()]
        assert particles == sorted(particles), name
        assert known["finest"].error < known["small"].error + 1e-3, name
