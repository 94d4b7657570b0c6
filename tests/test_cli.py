"""The commands as a person types them, each in a process of its own."""

import json
import subprocess
import sys

import pytest

from msph.scene.library import shipped_scenes
from tests.scenes_kit import TEXT, write


def msph(*arguments, **options):
    command = [sys.executable, "-m", "msph", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, **options)


@pytest.mark.parametrize("command", ["play", "capture", "bench", "scenes", ""])
def test_help_names_every_option(command):
    result = msph(*command.split(), "--help")
    assert result.returncode == 0
    options = {"play": ["--set", "--arch"], "bench": ["--no-render", "--json"]}
    for option in options.get(command, []):
        assert option in result.stdout


def test_scenes_lists_all_and_prints_one():
    listing = msph("scenes").stdout
    assert all(name in listing for name in shipped_scenes())
    assert msph("scenes", "drop").stdout.startswith("#   |       ( )")
    assert "classic.stiffness" in msph("scenes", "--parameters").stdout


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["capture", "no_such_scene"], "no_such_scene: no such scene file or shipped scene"),
        (["play", "pool", "--set", "box.sise=3"], "box.sise: unknown key; did you mean 'size'?"),
        (["bench", "pool", "--set", "duration=soon"], "duration: input should be a valid number"),
        (["capture", "pool", "-o", "a.xyz"], "a.xyz: unknown kind of file"),
        (["capture", "pool", "--mesh", "a_%04d.mp4"], "known: .ply, .obj"),
        (["capture", "pool", "--particles", "a.png"], "known: .npz, .csv"),
        (["bench", "pool", "--json", "/dev/null/rows.json"], "/dev/null/rows.json: "),
        (["capture", "pool", "--size", "big"], "is no size such as 1280x720"),
        (["capture", "pool", "--seconds", "-1"], "-1.0 is not in the range x>0"),
        (["scenes", "pol"], "did you mean 'pool'?"),
        (["swim"], "No such command 'swim'"),
    ],
)
def test_bad_input_is_one_line_and_exit_2(arguments, message):
    result = msph(*arguments)
    assert result.returncode == 2
    assert len(result.stderr.strip().splitlines()) == 1
    assert result.stderr.startswith("msph: ") and message in result.stderr


def test_bench_prints_speed_beside_error_and_writes_json(tmp_path):
    scene, rows = write(tmp_path), tmp_path / "deep" / "rows.json"
    result = msph("bench", scene, "--seconds", 0.1, "--arch", "cpu", "--json", rows)
    assert result.returncode == 0, result.stderr
    for column in ("ms p50", "p95", "bin solve surface picture", "momentum drift", "energy gain"):
        assert column in result.stdout
    (row,) = json.loads(rows.read_text())
    assert row["frames"] == 6 and sum(row["particles"]) > 200
    assert all(row["stages_p50_ms"][s] > 0.0 for s in ("bin", "solve", "surface", "picture"))
    assert abs(row["volume_error"]) < 0.3


def test_bench_without_render_times_the_fluid_alone(tmp_path):
    rows = tmp_path / "rows.json"
    result = msph("bench", write(tmp_path), "--seconds", 0.05, "--no-render", "--json", rows)
    assert result.returncode == 0, result.stderr
    (row,) = json.loads(rows.read_text())
    assert row["stages_p50_ms"]["surface"] == row["stages_p50_ms"]["picture"] == 0.0


def test_bench_of_water_that_blows_up_fails(tmp_path):
    explode = ["--set", "water.1.velocity=[0, 1e30, 0]", "--set", "box.restitution=1"]
    result = msph("bench", write(tmp_path), "--seconds", 0.1, "--no-render", *explode)
    assert result.returncode == 1
    assert "FAILED" in result.stderr


def test_capture_never_overwrites_the_scene_it_was_given(tmp_path):
    scene = write(tmp_path)
    result = msph(
        "capture", scene, "-o", tmp_path / "small.png", "--seconds", 0.01, "--size", "64x36"
    )
    assert result.returncode == 0, result.stderr
    assert (tmp_path / "small.toml").read_text() == TEXT
    assert "seed = 0" in (tmp_path / "small.scene.toml").read_text()


def test_capture_resumes_from_a_checkpoint(tmp_path):
    scene, target = write(tmp_path), tmp_path / "p_%04d.npz"
    first = msph("capture", scene, "--particles", target, "--seconds", 0.1)
    assert first.returncode == 0, first.stderr
    last = tmp_path / "p_0002.npz"
    assert (tmp_path / "p.scene.toml").exists()
    again = msph(
        *("capture", scene, "--particles", tmp_path / "q_%04d.npz", "--seconds", 0.1),
        *("--resume", last),
    )
    assert again.returncode == 0, again.stderr
    import numpy as np

    with np.load(tmp_path / "q_0002.npz") as state:
        assert state["time"] == pytest.approx(0.2)
