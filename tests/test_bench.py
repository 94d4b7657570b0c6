"""Tests of the benchmark scripts, at sizes that take seconds."""

import importlib.util
import math

import numpy as np
import pytest

from bench import constants, impact, parts, peer_splishsplash, peer_surfaces, peers, scale
from bench.methods import solve


def test_conjugate_gradients_take_fewer_iterations_than_jacobi() -> None:
    """Conjugate gradients need fewer iterations than Jacobi for the same error in water 12 spacings
    deep, with the initial guess 0 and with the pressures of the last step."""
    found = [solve(layers=1, warm_start=warm, start=0, depth=12) for warm in (False, True)]
    for row in found:
        assert row["conjugate gradients: iterations"] < row["Jacobi: iterations"]


def test_peers_that_are_missing_are_named(monkeypatch) -> None:
    """Each missing program gives one message, and versions() does not list it."""
    absent = ("pysplishsplash", "mcubes")
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda n: None if n in absent else find(n))
    lines = peers.skipped_peers()
    assert lines[0].startswith("pysplishsplash is not installed")
    assert "PyMCubes is not installed" in lines[-1]
    assert "PyMCubes" not in peer_surfaces.versions()


def test_gap_of_peer_walls_gives_still_water_its_level(tmp_path, monkeypatch) -> None:
    """gap_of() finds the gap of 1.4 spacings, at which still water has its level, within 0.001.

    The level of the stub is 6 % too high for each tenth of a spacing by which the gap is too small.
    """
    levels = []

    def stub(_, task, __):
        levels.append(1.0 + 0.6 * (1.4 - task["gap"]))
        return {"level": levels[-1]}

    monkeypatch.setattr(peer_splishsplash, "GAPS", tmp_path / "gaps.csv")
    monkeypatch.setattr(peer_splishsplash.rows, "in_process", stub)
    size = (1.2, 0.6, 0.16)
    gap = peer_splishsplash.gap_of(size, 0.04)
    assert abs(levels[1] - 1.0) < 0.5 * abs(levels[0] - 1.0) and abs(gap - 1.4) < 1e-3
    # The gap is read from the table and not measured again.
    assert abs(peer_splishsplash.gap_of(size, 0.04) - gap) < 1e-3
    assert len(levels) == peer_splishsplash.GAP_ROUNDS


def test_tables_of_peers_work_without_peers() -> None:
    """The tables show our runs, and a dash for runs of a program that is not installed."""
    ours = peers.Run(10, 12, simulated=1.0, wall=2.0, steps=4, iterations=8, residual=[0.01])
    runs = {kind: [] for kind in peers.FLUIDS} | {peers.UNIFORM: [ours]}
    row = peers.speeds(peers.TANKS[0], 1.0, runs)
    assert row[peers.UNIFORM] == "0.5" and row[peers.THEIRS] == "-"
    assert [r["fluid"] for r in peers.details(peers.TANKS[0], runs)] == [peers.UNIFORM]


def test_slopes_and_layers_of_scale() -> None:
    """Exponents are fitted to large runs only, and finer pools have more layers."""
    sizes = [1e3, 1e4, 1e5, 1e6]
    assert abs(scale.slope(sizes, [5.0, 1.0, 10.0, 100.0]) - 1.0) < 1e-9
    layers = [scale.layers_of(n) for n in scale.ALONG]
    assert layers[0] >= 2 and layers == sorted(layers) and layers[-1] <= 16
    assert scale.scene_of(scale.LAYERED, 100).adaptation.capacity < 1_000_000 / 4


def test_disabled_parts_launch_no_kernels(monkeypatch) -> None:
    """A part launches no kernels of its own while disabled, and at least one per frame while
    enabled."""
    monkeypatch.setattr(parts, "UNTIMED", 0)
    monkeypatch.setattr(parts, "FRAMES", 2)
    monkeypatch.setattr(parts, "SPACING", 0.05)
    (tension,) = (part for part in parts.CASES if part.name == "tension")
    row = parts.measured(tension)
    assert row["kernels"][0] == row["launches"][0] == 0
    assert row["kernels"][1] > 0 and row["launches"][1] >= 1.0
    assert row["error"].endswith("% of the depth")
    assert parts.cells(row)["own kernels: off, on"].startswith("0, ")


def test_longer_averaging_times_lower_impact_pressures(monkeypatch) -> None:
    """The highest reading falls with the averaging time, and pressure and impulse fall with height.

    The front is slower than Ritter's bound 2 sqrt(g H), H = 0.7 m, whose stagnation pressure is
    13.7 kPa. Regression: means began with the first wet reading, so those at the impact were of few
    readings, up to 19.5 kPa.
    """
    monkeypatch.setattr(impact, "SECONDS", 0.6)
    rows = impact.run(1.26, 0.004)
    for row in rows:
        assert row["highest"] >= row["mean 0.01"] >= row["mean 0.05"] > 0.0
    foot, _, top = (row["mean 0.05"] for row in rows)
    assert 3.0 * top < foot < 0.5 * 1000.0 * 4.0 * 9.81 * 0.7
    assert rows[0]["impulse"] > rows[1]["impulse"] > rows[2]["impulse"]


@pytest.mark.parametrize(("window", "mean"), [(1.0, 4.0), (2.0, 4.0), (2.5, 3.2), (8.0, 1.0)])
def test_mean_pressures_are_over_the_whole_averaging_time(window, mean):
    """Readings of 4 Pa during 2 s, dry before and after."""
    readings = np.array([0.0, 0.0, 4.0, 4.0, 0.0])
    assert impact.highest_mean(readings, 1.0, window) == pytest.approx(mean)


def test_every_constant_that_is_varied_exists():
    """Every constant that bench/constants.py varies exists in the module given there.

    Regression: a constant that had been moved to another module ended the whole measurement.
    """
    named = [(module, name) for module, name, *_ in constants.TRIED if module != "scene"]
    for module, name in named:
        assert hasattr(importlib.import_module(constants.FLUID + module), name), (module, name)


@pytest.mark.parametrize("number", [8, 128, 706, 1575, 4703])
def test_splishsplash_blocks_have_the_exact_number_of_particles(number):
    """The blocks hold exactly the given number of particles, at least two along each edge.

    Regression: after 500 steps SPlisHSPlasH sorted surplus, inactive particles among the active.
    """
    blocks = peer_splishsplash.blocks_of(number)
    assert sum(math.prod(edges) for edges in blocks) == number and min(map(min, blocks)) >= 2


def test_a_number_of_particles_that_fills_no_blocks_is_refused():
    with pytest.raises(ValueError, match="11 particles do not fill two blocks"):
        peer_splishsplash.blocks_of(11)


@pytest.mark.skipif(peer_splishsplash.missing(), reason="needs pip install '.[peers]'")
def test_still_water_of_a_peer_keeps_its_level() -> None:
    """The level is right within 15 % with walls 1.5 spacings outside of our initial particles."""
    tank = {"edges": [0.3, 0.3], "depth": 0.3, "spacing": 0.05, "gap": 1.5}
    found = peer_splishsplash.rows.in_process(peer_splishsplash.__file__, tank, 300.0)
    assert found["level"] == pytest.approx(1.0, abs=0.15)
