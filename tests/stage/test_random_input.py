"""Tests of random input in small scenes: no water is lost, and it is at rest density at the end."""

import pytest

from bench.random_input import LIMITS, problems, run_scene
from msph.stage.touch import Touch
from tests.scenes_kit import POOL, WATER, load

OPEN = POOL.replace("[box]", "[box]\nopen = true")
# The water reaches one spacing below the rim, so that some gestures spill water in any order.
BRIMFUL = OPEN.replace("size = [0.4, 0.4, 0.4]", "size = [0.4, 0.19, 0.4]")
SCENES = {
    "open": BRIMFUL + WATER,
    "post": f"{OPEN}{WATER}[[bodies]]\nlo = [0.15, 0.0, 0.15]\nhi = [0.25, 0.4, 0.25]\n",
}


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_random_input_loses_no_water(name, tmp_path):
    scene = load(tmp_path, SCENES[name], "adaptation.enabled=true")
    found = run_scene(scene, name, 60, 1)
    assert problems(found) == []
    assert found["added [kg]"] > 0.0
    assert found["spilt [kg]"] > 0.0 or name != "open"


def test_mass_changes_and_other_problems_are_reported(tmp_path, monkeypatch):
    add = Touch.add_water

    def forgets(touch, x, v):
        add(touch, x, v)
        touch.simulation.world.parts.impulses.added_mass.total[None] = 0.0

    monkeypatch.setattr(Touch, "add_water", forgets)
    scene = load(tmp_path, SCENES["open"], "adaptation.enabled=true")
    (problem,) = problems(run_scene(scene, "open", 20, 1))
    assert problem.startswith("mass change")
    good = {**dict.fromkeys(LIMITS, 0.0), "ended": "finished"}
    assert not problems(good)
    assert problems({**good, "solver residual": float("nan")}) == ["solver residual nan"]
    assert problems({**good, "ended": "the water blew up"}) == ["the water blew up"]
