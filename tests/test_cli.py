"""Tests of the commands as a user types them, in this process unless its start or end matters."""

import json
import signal
import sys
import time

import imageio.v2 as imageio
import numpy as np
import pytest

from msph import parameter
from msph.ending import unexpected
from msph.measure.table import read
from msph.scene import load_scene
from msph.scene.library import shipped_scenes
from msph.stage.preparation import mass_text
from tests.command_kit import done, here, python, started
from tests.scenes_kit import GAUGE, TEXT, write
from tests.tiers import slow_but


def test_scenes_lists_all_and_prints_one():
    listing = here("scenes").stdout
    assert all(name in listing for name in shipped_scenes())
    assert here("scenes", "drop").stdout.startswith("#   |       ( )")
    assert "classic.stiffness" in here("scenes", "--parameters").stdout


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["capture", "no_such_scene"], "no_such_scene: no such scene file or shipped scene"),
        (["capture", "pool", "-o", "a.xyz"], "a.xyz: unknown kind of file"),
        (["capture", "pool", "--mesh", "a_%04d.mp4"], "known: .ply, .obj, .vtu"),
        (["capture", "pool", "--particles", "a.png"], "known: .npz, .csv, .vtu"),
        (["bench", "pool", "--json", "/dev/null/rows.json"], "/dev/null: is a file, not a folder"),
        (["bench", "pool", "--seconds", "nan"], "'nan' is not a finite number"),
        (["capture", "pool", "--fps", "inf"], "inf is not in the range"),
        (["capture", "pool", "-o", "a" * 300 + ".mp4"], "file name too long"),
        (["capture", "pool", "-o", "a.png", "-o", "tests/../a.png"], "output is named twice"),
        (
            ["capture", "pool", "-o", "f_%d.png", "-o", "f_0.png"],
            "f_0.png: two outputs would write",
        ),
        (
            ["capture", "pool", "--particles", "p_%04d.vtu", "--mesh", "p-%04d.vtu"],
            "p.pvd: two outputs would write this file",
        ),
        (["bench", "pool", "--json", "tests"], "tests: is a directory"),
        (["bench", "pool", "--set", "gravity.1=-3"], "gravity is not set in this scene"),
        (["bench", "pool", "--set", "title=\udce9"], "is not valid Unicode text"),
        (["capture", "pool", "--size", "big"], "expected WIDTHxHEIGHT"),
        (["capture", "pool", "--seconds", "-1"], "-1.0 is not in the range 0<x<=1000000"),
        (["measure", "pool", "-o", "/dev/null/here"], "/dev/null/here: not a directory"),
        (["measure", "pool", "--every", "0"], "measure.every: input should be greater than"),
        (["capture", "pool", "--seconds", "1e300", "-o", "x_%d.png"], "1e+300 is not in the range"),
        (
            ["capture", "pool", "--seconds", "1e6", "--fps", "100", "-o", "x_%d.png"],
            "x_%d.png: would have 100,000,000 frames; at most 1,000,000 are allowed",
        ),
        (["measure", "pool", "--seconds", "-1"], "duration: input should be greater than 0"),
        (
            ["bench", "pool", "--quality", "small", "--set", "variant=system-1"],
            "pool: --quality: has only the quality large: its number of particles is given",
        ),
        (["measure", "pool", "--converge", "2"], "2 is not in the range 3<=x<=5"),
        (["measure", "pool", "--resume", "Makefile"], "Makefile: is not a checkpoint"),
        (["measure", "pool", "--resume", "none.npz"], "'none.npz' does not exist"),
        (
            ["measure", "pool", "--resume", "Makefile", "--converge", "3"],
            "--converge and --resume exclude each other",
        ),
        (
            ["measure", "pool", "--converge", "3", "--set", "variant=system-1"],
            "pool: --converge: spacings cannot change: its number of particles is given",
        ),
        (
            ["measure", "still", "--converge", "5", "--set", "layers.0.spacing=0.2"],
            "still with spacings multiplied by 4.00: layers.0: particles of 0.8 m do not fit",
        ),
        (["bench", "pool", "--play", "--no-render"], "--play and --no-render exclude each other"),
        (["bench", "pool", "--play", "--profile"], "--play and --profile exclude each other"),
        (["capture", "pool", "--mesh-layer", "-o", "x.png"], "--mesh-layer needs --mesh or --usd"),
        (["scenes", "pol"], "did you mean 'pool'?"),
        (["swim"], "No such command 'swim'"),
    ],
)
def test_bad_input_gives_one_line_and_exit_code_2(arguments, message):
    check_refusal(here(*arguments), message)


def test_an_unexpected_error_gives_one_line_and_a_report(cache, monkeypatch):
    monkeypatch.setattr("msph.stage.commands.scenes", lambda **_: {}["a key\nthat is missing"])
    result = here("scenes")
    assert result.returncode == 1
    assert result.stderr.count("\n") == 1 and "unexpected error: KeyError" in result.stderr
    (report,) = cache.parent.glob("crash_*.txt")
    assert str(report) in result.stderr and "Traceback" in report.read_text()


def check_refusal(result, message):
    assert result.returncode == 2
    assert len(result.stderr.strip().splitlines()) == 1
    assert result.stderr.startswith("msph: ") and message in result.stderr


def test_bench_prints_speed_and_errors_and_writes_json(tmp_path):
    scene, rows = write(tmp_path), tmp_path / "deep" / "rows.json"
    result = done("bench", scene, "--seconds", 0.1, "--json", rows)
    columns = ("ms p50", "p95", "fluid / surface / image", "kernel / bulk density err %")
    for column in (*columns, "momentum drift", "energy gain"):
        assert column in result.stdout
    (row,) = json.loads(rows.read_text())
    assert row["frames"] == 6 and sum(row["particles"]) > 200
    assert all(row["stages_p50_ms"][s] > 0.0 for s in ("fluid", "surface", "picture"))
    assert abs(row["volume_error"]) < 0.3
    assert 0.0 < row["kernel_density_error"] < 0.3
    bulk = row["bulk_density_error"]
    assert " / unknown" in result.stdout if bulk is None else 0.0 < bulk < 0.1
    assert row["profile_ms"] == {} and "profiled" not in result.stdout


def test_bench_without_render_times_the_fluid_alone_and_its_parts(tmp_path):
    rows, options = tmp_path / "rows.json", ("--seconds", 0.05, "--no-render", "--profile")
    result = done("bench", write(tmp_path), *options, "--json", rows)
    (row,) = json.loads(rows.read_text())
    assert row["stages_p50_ms"]["surface"] == row["stages_p50_ms"]["picture"] == 0.0
    parts = ["neighbours", "density", "forces", "drift", "other"]
    assert list(row["profile_ms"]) == ["fluid", *(f"fluid/{part}" for part in parts)]
    assert "profiling slows the run" in result.stdout
    printed = [line.split()[0] for line in result.stdout.splitlines() if line.endswith(" %")]
    assert printed == ["fluid", *parts]


def test_bench_fails_if_the_simulation_blows_up(tmp_path, monkeypatch):
    monkeypatch.setattr(parameter, "LARGEST", 1e38)
    explode = ["--set", "water.1.velocity=[0, 1e30, 0]", "--set", "box.restitution=1"]
    result = here("bench", write(tmp_path), "--seconds", 0.1, "--no-render", *explode)
    assert result.returncode == 1
    assert "FAILED" in result.stderr


def test_no_output_replaces_an_input_even_with_force(tmp_path):
    """Regression: the scene file of a recording replaced the scene that it was made of."""
    scene = tmp_path / "mine.scene.toml"
    scene.write_text(TEXT)
    result = here("capture", scene, "-o", tmp_path / "mine.png", "--seconds", 0.01, "--force")
    check_refusal(result, "mine.scene.toml: is an input of this command; choose another name")
    assert scene.read_text() == TEXT


@pytest.mark.skipif(sys.platform == "win32", reason="sends an interrupt")
@pytest.mark.parametrize("wait", slow_but([0.15], [0.15, "then running"]))
def test_an_interrupt_ends_the_program_at_any_time(tmp_path, wait):
    """Regression: 4 of 10 interrupts during imports were lost in callbacks, or gave tracebacks."""
    scene, said = write(tmp_path), PYTHON_STARTS
    for _ in range(5):
        if PYTHON_STARTS in said:
            code, said = interrupted(scene, wait)
    assert code in (-signal.SIGINT, 130)
    assert "Traceback" not in said


# Text of the traceback if Python itself is interrupted at its start, which is slow under load.
PYTHON_STARTS = "init_import_site"


def interrupted(scene, wait):
    """Returns exit status and stderr of a run interrupted after `wait`: seconds, or a text."""
    process = started("bench", scene, "--seconds", "100")
    said = ""
    if isinstance(wait, float):
        time.sleep(wait)
    else:
        while wait not in said:
            said += process.stderr.read(1)
    process.send_signal(signal.SIGINT)
    try:
        said += process.communicate(timeout=60)[1]
    finally:
        process.kill()
    return process.returncode, said


def test_capture_warns_once_that_inflows_waited(tmp_path):
    """Regression: only the window and `measure` warned."""
    inflow = "inflows=[{centre=[0.2, 0, 0.2], radius=0.1, speed=0.5}]"
    options = ("--set", "method=projection", "--set", inflow, "--set", "duration=0.02")
    target = tmp_path / "p_%d.csv"
    found = done(
        *("capture", write(tmp_path), *options, "--particles", target),
        *("--seconds", 0.4, "--fps", 10),
    )
    assert found.stderr.count("inflows have waited for") == 1


def test_capture_resumes_from_a_checkpoint(tmp_path):
    scene, target = write(tmp_path), tmp_path / "p_%04d.npz"
    done("capture", scene, "--particles", target, "--seconds", 0.1)
    last = tmp_path / "p_0002.npz"
    assert (tmp_path / "p.scene.toml").exists()
    done(
        *("capture", scene, "--particles", tmp_path / "q_%04d.npz", "--seconds", 0.2),
        *("--resume", last),
    )
    # File names continue with the number of the frame, so that no file is overwritten.
    assert not (tmp_path / "q_0002.npz").exists()
    with np.load(tmp_path / "q_0005.npz") as state:
        assert state["time"] == pytest.approx(0.2)


PRESSURE = """
[[probes]]
name = "floor"
kind = "pressure"
point = [0.2, 0, 0.2]
"""


def test_measure_writes_probes_ledger_and_a_summary(tmp_path):
    scene, out = write(tmp_path, TEXT + PRESSURE + GAUGE), tmp_path / "deep" / "out"
    result = done(
        *("measure", scene, "-o", out, "--seconds", 0.1, "--every", 0.02, "--arch", "cpu"),
        *("--set", "measure.survey=0.04"),
    )
    readings, ledger = read(out / "probes.csv"), read(out / "ledger.csv")
    assert list(readings) == ["time_s", "floor_Pa", "gauge_m"]
    assert readings["time_s"] == pytest.approx([0.0, 0.02, 0.04, 0.06, 0.08, 0.1])
    # The water is 0.18 m deep.
    assert readings["floor_Pa"][0] == pytest.approx(9810 * 0.18, rel=0.03)
    assert readings["floor_Pa"][1] != 0.0
    assert readings["gauge_m"][0] == pytest.approx(0.18, abs=0.01)
    assert ledger["time_s"] == pytest.approx(readings["time_s"])
    assert ledger["mass_kg"][0] == pytest.approx(28.8, rel=0.02)
    surveyed = np.isfinite(ledger["volume_m3"]).tolist()
    assert surveyed == [True, False, True, False, True, True]
    summary = json.loads((out / "summary.json").read_text())
    assert summary["complete"] and summary["failure"] is None and summary["method"] == "classic"
    assert summary["simulated_s"] == pytest.approx(0.1) and summary["frames"] == 5
    assert summary["frame_ms_p25"] <= summary["frame_ms_p50"] <= summary["frame_ms_p75"]
    assert summary["steps"] > 5 and sum(summary["particles_end"]) > 200
    assert summary["mass_asked_kg"] == pytest.approx(28.8)
    assert summary["mass_laid_kg"] == pytest.approx(28.8, abs=0.064 + 0.128)
    errors = summary["errors"]
    laid = summary["mass_laid_kg"] / summary["mass_asked_kg"] - 1.0
    assert errors["mass_laid_error"] == pytest.approx(laid, abs=1e-12)
    assert f" particles, {summary['mass_laid_kg']:.4g} kg" in result.stderr
    assert abs(errors["volume_error_last"]) < 0.3 and errors["energy_gain"] >= 0.0
    assert np.isfinite(ledger["kernel_density_error_mean"]).tolist() == surveyed
    bulk = ledger["bulk_density_mean"][np.isfinite(ledger["bulk_density_mean"])]
    assert errors["bulk_density_error_last"] == pytest.approx(bulk[-1] - 1.0, abs=1e-8)
    # The same figures are printed, with a caution for each that is beyond its limit.
    for words in (
        "Errors of this run",
        "initial mass",
        "bulk density error",
        "kernel density error",
        "limit",
    ):
        assert words in result.stdout
    depth = 2.0 * ledger["centre_y_m"].mean()
    assert summary["resolution"]["spacings_across_depth"] == pytest.approx(depth / 0.04, rel=1e-4)
    assert summary["limits"]["spacings_across_depth"] > depth / 0.04
    assert any("across the mean depth: " in caution for caution in summary["cautions"])
    assert all(f"caution: {caution}" in result.stdout for caution in summary["cautions"])
    for plot in ("ledger.png", "probes.png"):
        assert np.ptp(imageio.imread(out / plot)) > 100
    again = load_scene(str(out / "scene.toml"))
    assert again.measure.every == 0.02 and again.duration == 0.1 and len(again.probes) == 2


def test_measure_keeps_its_results_if_the_simulation_blows_up(tmp_path, monkeypatch):
    monkeypatch.setattr(parameter, "LARGEST", 1e38)
    explode = ["--set", "water.1.velocity=[0, 1e30, 0]", "--set", "box.restitution=1"]
    out = tmp_path / "out"
    result = here("measure", write(tmp_path), "-o", out, "--set", "measure.survey=0", *explode)
    assert result.returncode == 1
    last = result.stderr.strip().splitlines()[-2:]
    assert last[0].endswith("out holds the results until then")
    assert last[1].startswith("msph: the water blew up: ")
    summary = json.loads((out / "summary.json").read_text())
    assert not summary["complete"] and summary["failure"] in last[1]
    assert "kinetic_J" in (out / "ledger.csv").read_text()


def test_initial_and_specified_mass_are_both_given_if_they_differ():
    assert mass_text({"mass_laid_kg": 28.8001, "mass_asked_kg": 28.8}) == "28.8 kg"
    told = mass_text({"mass_laid_kg": 28.9, "mass_asked_kg": 28.8})
    assert told == "28.9 kg of 28.8 kg specified"


def test_help_needs_no_taichi():
    """The commands import neither Taichi nor other slow libraries: --help takes at most 0.4 s."""
    slow = {"taichi", "numpy", "pydantic", "PIL"}
    script = f"import sys, msph.cli; print(*{slow} & set(sys.modules))"
    assert python("-c", script).stdout.strip() == ""


@pytest.mark.skipif(sys.platform == "win32", reason="sends a signal")
def test_a_signal_before_the_first_frame_leaves_a_summary(tmp_path):
    """Regression: during the compilation of kernels SIGTERM ended the process without a message."""
    folder = tmp_path / "out"
    process = started("measure", write(tmp_path), "-o", folder)
    deadline = time.monotonic() + 60.0
    # The file is empty until the run begins.
    while not (folder / "scene.toml").exists() or not (folder / "scene.toml").stat().st_size:
        assert time.monotonic() < deadline and process.poll() is None
        time.sleep(0.05)
    process.send_signal(signal.SIGTERM)
    said = process.communicate(timeout=60)[1]
    assert process.returncode == 128 + signal.SIGTERM
    assert said.rstrip().endswith("msph: interrupted") and "Traceback" not in said
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["failure"] == "interrupted" and not summary["complete"]


def test_insufficient_memory_is_reported(cache):
    """Regression: they were reported as unexpected errors, with a line of Taichi's C++."""
    said = "[host_memory_pool.cpp] Virtual memory allocation (1073741824 B) failed."
    for error in (MemoryError(), RuntimeError(said), RuntimeError("std::bad_alloc")):
        assert unexpected(error).startswith("not enough memory")
    assert unexpected(RuntimeError("other")).startswith("unexpected error")
