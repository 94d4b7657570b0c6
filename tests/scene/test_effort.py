"""Tests that scenes with a long preparation or very many steps give a caution or are refused."""

import pytest
import trimesh

from msph.scene import SceneError
from msph.scene.bodies import bodies
from msph.scene.effort import effort, in_words, steps_per_second
from msph.scene.water import layer_specs
from tests.scenes_kit import CUBE, load

BALL = "bodies=[{centre=[0.5, 0.2, 0.5], radius=0.1, "


def scene(tmp_path, *overrides):
    return load(tmp_path, CUBE, "layers=[{spacing=0.05}]", *overrides)


def test_short_steps_are_reported_with_their_elapsed_time(tmp_path):
    (line,) = effort(scene(tmp_path, "projection.longest_step=1e-6"))
    # 4,000 particles: a million steps of 1 ms + 10 ms each.
    assert line.startswith("projection.longest_step: requires 1,000,000 steps per simulated second")
    assert "3.1 hours" in line


def test_fast_bodies_are_reported_or_refused(tmp_path):
    fast = scene(tmp_path, BALL + "velocity=[400, 0, 0]}]")
    steps, key = steps_per_second(fast, layer_specs(fast), bodies(fast))
    assert steps == pytest.approx(400.0 / (0.5 * 0.05)) and key == "bodies.0"
    assert effort(fast)
    for motion in ("velocity=[2000, 0, 0]", "spin=1e6", "swing=[0.3, 0, 0], period=1e-4"):
        with pytest.raises(SceneError, match=r"bodies\.0: its surface moves at"):
            scene(tmp_path, BALL + motion + "}]")


def test_stiff_classic_water_is_reported(tmp_path):
    text = ("method=classic", "classic.stiffness=1e6")
    assert effort(scene(tmp_path, *text))[0].startswith("classic.stiffness")


def test_large_meshes_are_reported(tmp_path, monkeypatch):
    trimesh.creation.icosphere(2, radius=0.1).export(tmp_path / "ball.stl")
    monkeypatch.setattr("msph.scene.effort.FACE_TIME", 0.1)
    given = "bodies=[{mesh='ball.stl', position=[0.5, 0.3, 0.5]}]"
    assert effort(scene(tmp_path, given)) == [
        "meshes of 320 faces take about 32 seconds to prepare"
    ]


@pytest.mark.parametrize(
    ("seconds", "words"), [(7.0, "7 seconds"), (90.0, "1.5 minutes"), (2e5, "2.3 days")]
)
def test_times_are_formatted_in_the_largest_fitting_unit(seconds, words):
    assert in_words(seconds) == words
