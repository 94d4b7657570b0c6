"""Tests of motions of the tank and of wave makers in scenes."""

import math

import numpy as np
import pytest

from msph.expressions import ExpressionError
from msph.scene import SceneError, load_scene
from msph.scene.load import to_toml
from msph.scene.motion import box_path
from msph.scene.wavemakers import group_speed, wave_makers, wave_number

TANK = """
duration = 4.0
[box]
size = [2.0, 0.6, 0.2]
[[layers]]
spacing = 0.04
[[water]]
lo = [0, 0, 0]
hi = [2, 0.4, 0.2]
"""


def load(tmp_path, text, *overrides):
    file = tmp_path / "tank.toml"
    file.write_text(TANK + text)
    return load_scene(str(file), overrides)


def test_motions_are_applied_in_their_order(tmp_path):
    text = """
[[motion]]
angle = "90 * t"
centre = [0, 0, 0]
[[motion]]
displacement = [0, "0.1 * sin(pi * t / 2)", 0.5]
"""
    scene = load(tmp_path, text)
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
    path = box_path(load(tmp_path, '[motion]\ntable = "surge.csv"\n'))
    assert path(0.777)[0][0] == pytest.approx(0.05 * math.sin(0.5 * math.pi * 0.777) ** 2, abs=1e-6)
    assert path(5.0)[0] == pytest.approx(np.zeros(3), abs=1e-12)


def test_a_sway_begins_and_ends_at_rest(tmp_path):
    path = box_path(load(tmp_path, "[sway]\nangle = 8\nperiod = 1.0\nseconds = 3.2\n"))
    angles = np.array([math.asin(path(t)[1][1, 0]) for t in np.linspace(0.0, 4.0, 4001)])
    assert math.degrees(angles.max()) == pytest.approx(8.0, rel=1e-3)
    assert np.abs(angles[3200:]).max() == 0.0
    accelerations = np.diff(angles, 2) * 1e6
    assert np.abs(accelerations).max() < 3.0 * math.radians(8.0) * (2.0 * math.pi) ** 2
    assert np.abs(np.diff(accelerations)).max() < 0.2 * np.abs(accelerations).max()


BAD = {
    "name": (
        '[motion]\nangle = "4*sine(t)"\n',
        "motion.0.angle: unknown function 'sine'; did you mean 'sin'?",
    ),
    "code": (
        "[motion]\nangle = '__import__(\"os\").nice(1)'\n",
        "motion.0.angle: only names have numbers, not \"__import__('os')\"",
    ),
    "variable": ('[motion]\nangle = "x"\n', "motion.0.angle: unknown name 'x'; known: t, pi"),
    "syntax": ('[motion]\nangle = "4*"\n', "motion.0.angle: is not an expression: '4*'"),
    "undefined": (
        '[motion]\ndisplacement = [0, "sqrt(2 - t)", 0]\n',
        "motion.0.displacement.1: 'sqrt(2 - t)' is not a number at t = 2",
    ),
    "power": (
        '[motion]\nangle = "9**4000000*0+t"\n',
        "motion.0.angle: '9**4000000*0+t' is not a number at t = 0 s",
    ),
    "floors": (
        '[motion]\nangle = "floor(1e300)**9999999*floor(1e300)*0+t"\n',
        "is not a number at t = 0 s",
    ),
    "text": (
        "[motion]\nangle = \"f'{t:>99999999}'\"\n",
        "motion.0.angle: may hold numbers, names, functions",
    ),
    "long": (f'[motion]\nangle = "{"t+" * 500}t"\n', "motion.0.angle: has 1001 characters"),
    "fast": ('[motion]\nangle = "1e9*t"\n', "motion: the tank moves at "),
    "aliased": ('[motion]\nangle = "90*sin(1e6*t)"\n', "motion: the tank moves at "),
    "huge": ('[motion]\nangle = "1e13*t"\n', "s: must be -1e+12 to 1e+12"),
    "short": ("[sway]\nangle = 1\nperiod = 1e-320\n", "sway.period: input should be greater"),
    "axis": ("[motion]\naxis = [0, 0, 0]\n", "motion.0.axis: has no direction"),
    "no table": (
        '[motion]\ntable = "nosuch.csv"\n',
        "motion.0.table: nosuch.csv: cannot be read: No such file",
    ),
    "both": (
        '[motion]\ntable = "a.csv"\nangle = 3\n',
        "motion.0: give either a table, or displacement and angle",
    ),
    "waves": (
        "[[wavemakers]]\nstroke = 0.1\nperiod = 1e-5\n",
        "wavemakers.0.period: input should be greater than or equal to 0.01",
    ),
    "still": (
        "[[wavemakers]]\nstroke = 0.1\nperiod = 1e300\n",
        "wavemakers.0.period: input should be less than or equal to 1000",
    ),
    "large": (
        "[[bodies]]\ncentre = [1, 1, 1]\nradius = 1e154\n",
        "bodies.0.radius: must be -1e+12",
    ),
    "stroke": (
        "[[wavemakers]]\nstroke = 0.1\nperiod = 1\nposition = 0.01\n",
        "wavemakers.0.position: must be at least 0.099 m",
    ),
    "no room": (
        "[[wavemakers]]\nstroke = 0.1\nperiod = 1\nbeach = 1.9\n",
        "wavemakers.0: with its stroke and beach it does not fit in 2 m",
    ),
    "same end": (
        "[[wavemakers]]\nstroke = 0.1\nperiod = 1\n[[wavemakers]]\nstroke = 0.1\nperiod = 1\n",
        "wavemakers.1.end: wavemakers.0 is at this end",
    ),
    "opposite": (
        "[[wavemakers]]\nstroke = 0.1\nperiod = 1\nbeach = 0.5\n"
        '[[wavemakers]]\nend = "+x"\nstroke = 0.1\nperiod = 1\n',
        "wavemakers.0.beach: there is a wave maker at the other end",
    ),
    "steep": (
        '[[wavemakers]]\nkind = "flap"\nstroke = 0.9\nperiod = 1\n',
        "wavemakers.0.stroke: would tilt the flap by more than 45 degrees (got 0.9)",
    ),
    "classic": (
        'method = "classic"\n[[wavemakers]]\nstroke = 0.1\nperiod = 1\n',
        "wavemakers: the method classic has none; projection has",
    ),
    "upwards": (
        "gravity = [0, 9.81, 0]\n[[wavemakers]]\nstroke = 0.1\nperiod = 1\n",
        "wavemakers: need gravity along -y",
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_motions_give_one_line_with_their_key(tmp_path, name):
    text, message = BAD[name]
    if name in ("classic", "upwards"):
        head, _, rest = text.partition("\n")
        file = tmp_path / "tank.toml"
        file.write_text(f"{head}\n{TANK}{rest}")
        with pytest.raises(SceneError) as error:
            load_scene(str(file))
    else:
        with pytest.raises(SceneError) as error:
            load(tmp_path, text)
    assert message in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize("rows", ["0,1e308\n1,0", "0,0\n1e-200,1", "0,0\n1e-5,1"])
def test_impossible_tables_are_refused(tmp_path, rows):
    (tmp_path / "a.csv").write_text(f"time_s,x_m\n{rows}")
    with pytest.raises(SceneError, match=r"motion\b"):
        load(tmp_path, '[motion]\ntable = "a.csv"\n')


def test_expressions_need_no_value_outside_the_duration(tmp_path):
    """Regression: a trial at an odd time refused expressions that the duration allows."""
    text = '[motion]\ndisplacement = [0, "0.1 * sqrt(4 - t) * sqrt(t)", 0]\n'
    path = box_path(load(tmp_path, text.replace("sqrt(4 - t)", "(4 - t)**1.5")))
    assert path(-1e-4)[0][1] == path(4.001)[0][1] == 0.0
    with pytest.raises(ExpressionError, match=r"motion\.0\.displacement\.1: .* t = 4.2 s"):
        path(4.2)


@pytest.mark.parametrize("end", ["-x", "+x", "-z"])
def test_a_flap_swings_about_the_floor_towards_the_water(tmp_path, end):
    keys = f'end = "{end}"\nkind = "flap"\nstroke = 0.1\nperiod = 2\nramp = 0\n'
    text = "[[wavemakers]]\n" + keys
    if end == "-z":
        text = text.replace("0.1", "0.02")
    scene = load(tmp_path, text)
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
    scene = load(tmp_path, "[[wavemakers]]\nstroke = 0.1\nperiod = 0.9\n")
    periods = np.array([0.899, 0.901])
    k = [wave_number(t, 0.4, 9.81) for t in periods]
    speed = np.diff(2.0 * math.pi / periods)[0] / np.diff(k)[0]
    assert group_speed(scene, scene.wavemakers[0]) == pytest.approx(speed, rel=1e-4)
