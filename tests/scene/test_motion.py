"""Tests of motions of the tank and of wave makers in scenes."""

import math

import numpy as np
import pytest

from msph.expressions import ExpressionError
from msph.scene import SceneError, load_scene
from msph.scene.load import to_toml
from msph.scene.motion import box_path
from msph.scene.wavemakers import group_speed, wave_makers, wave_number
from tests.scenes_kit import TANK, load


def test_motions_are_applied_in_their_order(tmp_path):
    text = """
[[motion]]
angle = "90 * t"
centre = [0, 0, 0]
[[motion]]
displacement = [0, "0.1 * sin(pi * t / 2)", 0.5]
"""
    scene = load(tmp_path, TANK + text)
    shift, turned = box_path(scene)(1.0)
    assert turned == pytest.approx(np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]]), abs=1e-12)
    # The rotation about the corner moves the centre from (1, 0.3, 0.1) m to (-0.3, 1, 0.1) m.
    assert shift == pytest.approx([-1.3, 0.7 + 0.1, 0.5])
    again = tmp_path / "again.toml"
    again.write_text(to_toml(scene, "a copy"))
    assert load_scene(str(again)) == scene


def test_motion_table_is_interpolated_smoothly_and_ends_at_its_last_row(tmp_path):
    times = np.linspace(0.0, 2.0, 41)
    rows = [f"{t},{0.05 * math.sin(math.pi * t / 2) ** 2}" for t in times]
    (tmp_path / "surge.csv").write_text("\n".join(["time_s,x_m", *rows]))
    path = box_path(load(tmp_path, TANK + '[motion]\ntable = "surge.csv"\n'))
    assert path(0.777)[0][0] == pytest.approx(0.05 * math.sin(0.5 * math.pi * 0.777) ** 2, abs=1e-6)
    assert path(5.0)[0] == pytest.approx(np.zeros(3), abs=1e-12)


def test_a_sway_begins_and_ends_at_rest(tmp_path):
    path = box_path(load(tmp_path, TANK + "[sway]\nangle = 8\nperiod = 1.0\nseconds = 3.2\n"))
    angles = np.array([math.asin(path(t)[1][1, 0]) for t in np.linspace(0.0, 4.0, 4001)])
    assert math.degrees(angles.max()) == pytest.approx(8.0, rel=1e-3)
    assert np.abs(angles[3200:]).max() == 0.0
    accelerations = np.diff(angles, 2) * 1e6
    assert np.abs(accelerations).max() < 3.0 * math.radians(8.0) * (2.0 * math.pi) ** 2
    assert np.abs(np.diff(accelerations)).max() < 0.2 * np.abs(accelerations).max()


@pytest.mark.parametrize("rows", ["0,1e308\n1,0", "0,0\n1e-200,1", "0,0\n1e-5,1"])
def test_impossible_tables_are_refused(tmp_path, rows):
    (tmp_path / "a.csv").write_text(f"time_s,x_m\n{rows}")
    with pytest.raises(SceneError, match=r"motion\b"):
        load(tmp_path, TANK + '[motion]\ntable = "a.csv"\n')


def test_expressions_need_no_value_outside_the_duration(tmp_path):
    """Regression: a trial at an odd time refused expressions that the duration allows."""
    text = '[motion]\ndisplacement = [0, "0.1 * sqrt(4 - t) * sqrt(t)", 0]\n'
    path = box_path(load(tmp_path, TANK + text.replace("sqrt(4 - t)", "(4 - t)**1.5")))
    assert path(-1e-4)[0][1] == path(4.001)[0][1] == 0.0
    with pytest.raises(ExpressionError, match=r"motion\.0\.displacement\.1: .* t = 4.2 s"):
        path(4.2)


@pytest.mark.parametrize("end", ["-x", "+x", "-z"])
def test_a_flap_swings_about_the_floor_towards_the_water(tmp_path, end):
    keys = f'end = "{end}"\nkind = "flap"\nstroke = 0.1\nperiod = 2\nramp = 0\n'
    text = "[[wavemakers]]\n" + keys
    if end == "-z":
        text = text.replace("0.1", "0.02")
    scene = load(tmp_path, TANK + text)
    (maker,) = wave_makers(scene)
    axis, far = "xyz".index(end[1]), end[0] == "+"
    face = (maker.lo if far else maker.hi)[axis]
    centre = 0.5 * (maker.lo + maker.hi)
    for height, share in ((0.0, 0.0), (0.4, 1.0)):
        point = centre.copy()
        point[axis], point[1] = face, height
        moved = centre + maker.motion.offset(0.5) + maker.motion.rotation(0.5) @ (point - centre)
        # After a quarter of the period the flap leans by half the stroke over the depth, 0.4 m.
        way = (moved - point)[axis] * (-1 if far else 1)
        slope = 0.5 * scene.wavemakers[0].stroke / 0.4
        assert way == pytest.approx(share * 0.4 * math.sin(math.atan(slope)), abs=1e-9)


def test_group_speed_agrees_with_linear_theory(tmp_path):
    scene = load(tmp_path, TANK + "[[wavemakers]]\nstroke = 0.1\nperiod = 0.9\n")
    periods = np.array([0.899, 0.901])
    k = [wave_number(t, 0.4, 9.81) for t in periods]
    speed = np.diff(2.0 * math.pi / periods)[0] / np.diff(k)[0]
    assert group_speed(scene, scene.wavemakers[0]) == pytest.approx(speed, rel=1e-4)
