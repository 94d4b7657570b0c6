"""Tests of the table of costs of a scene with and without each of its optional parts."""

import re

import pytest

from msph.scene import load_scene
from msph.scene.parts import PARTS
from msph.stage import explain
from tests.scenes_kit import load, write


@pytest.fixture
def scene(tmp_path):
    return load(tmp_path)


def test_active_parts_are_the_parts_that_a_scene_has(scene):
    def active(scene):
        return [part.name for part in PARTS if part.active(scene)]

    assert active(scene) == ["caustics", "whitewater", "wet walls", "ripples"]
    honey = load_scene("honey", ("projection.tension=0.1",))
    assert {"viscosity", "tension", "caustics"} <= set(active(honey))
    for part in PARTS:
        assert not part.active(part.without(honey))
    sticky = load_scene("honey", ("projection.slip=false",))
    (viscosity,) = (part for part in PARTS if part.name == "viscosity")
    # Without viscosity water cannot stick to walls.
    assert viscosity.without(sticky).projection.slip


@pytest.mark.slow
def test_the_table_has_costs_and_errors(tmp_path, monkeypatch):
    monkeypatch.setattr(explain, "SECONDS", 0.1)
    # Each active part is one more simulation, which compiles its kernels.
    off = [f"picture.{part}" for part in ("whitewater=false", "drying=0", "ripples=false")]
    told = explain.explain(load_scene(write(tmp_path), off))
    (whole,) = re.findall(r"full scene +(\d+) +([\d.]+) ", told)
    (bare,) = re.findall(r"without caustics +(\d+) .*?([-+]\d+) %.*?([\d.]+) of 255 a pixel", told)
    assert whole[0] == bare[0] == "324" and float(whole[1]) > 0.0
    # The images of the same particles differ by the caustics.
    assert float(bare[2]) > 0.1


def test_the_largest_saving_is_named():
    def run(milliseconds):
        return type("R", (), {"milliseconds": lambda self: milliseconds})()

    parts = [p for p in PARTS if p.name in ("viscosity", "tension")]
    told = explain.saving(parts, [run(9.0), run(5.0)], run(10.0))
    assert told == "Largest saving: without tension, 50 % of the frame time."
    assert "Nothing" in explain.saving(parts, [run(11.0), run(12.0)], run(10.0))
    assert "Nothing" in explain.saving([], [], run(10.0))
