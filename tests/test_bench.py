"""Tests of the benchmark scripts, at sizes that take seconds."""

import importlib.util
import math
import time

import numpy as np
import pytest
from click.testing import CliRunner

from bench import (
    constants,
    displaced_volume,
    floating,
    heave_theory,
    impact,
    peer_splishsplash,
    peer_surfaces,
    rows,
    run,
    scale,
    tables,
)


def test_peers_that_are_missing_are_named(monkeypatch) -> None:
    """A missing program is named, and versions() does not list it."""
    absent = ("pysplishsplash", "mcubes")
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda n: None if n in absent else find(n))
    assert peer_splishsplash.missing() and "PyMCubes" in peer_surfaces.missing()
    assert "PyMCubes" not in peer_surfaces.versions()


def test_gap_of_peer_walls_gives_still_water_its_level(tmp_path, monkeypatch) -> None:
    """The level of the stub is 6 % too high for each tenth of a spacing below 1.4 spacings."""
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


def test_surfaces_are_compared_with_the_fastest_other_program(monkeypatch) -> None:
    """Each method has a row with its triangles; without other programs the speed-up is unknown."""
    monkeypatch.setattr(peer_surfaces, "ROUNDS", 1)
    slow = peer_surfaces.Method("theirs", lambda: time.sleep(0.05), lambda: 7)
    ours = peer_surfaces.Method("ours", lambda: time.sleep(0.005), lambda: 8)
    found = peer_surfaces.in_turns("ball", [ours, slow])
    assert [row["triangles"] for row in found] == [8, 7]
    assert found[0]["speed-up over the fastest other"] > 2.0
    (alone,) = peer_surfaces.in_turns("ball", [ours])
    assert math.isnan(alone["speed-up over the fastest other"])


WIDE = tables.Table("Wide", ("body", "layers"), {("cube", "1"): lambda seed: {}}, {"error": ".1%"})
ACROSS = tables.Table(
    "Across",
    (),
    {("a",): lambda seed: {}, ("b",): lambda seed: {}},
    {"speed": ".1f", "error": ".1%"},
    {"speed": "5"},
    across=True,
)
BENCH = tables.Bench("Title", "Note.", {"wide": WIDE, "across": ACROSS})


def rows_of(table, case, *figures):
    """Returns the rows of a case, one for each start."""
    own = {"table": table, "case": case, "measured": "here"}
    return [{**own, "start": str(k), **f} for k, f in enumerate(figures)]


def cells_of(table, found):
    """Returns the cells of each line of a table that is shown."""
    lines = tables.shown(table, found).splitlines()
    return [[cell.strip() for cell in line.split("|")[1:-1]] for line in lines]


def test_tables_show_medians_and_ranges_of_the_starts():
    """Rows are grouped by first cells, figures are formatted, and what is unknown is a dash."""
    found = rows_of("wide", "cube | 1", {"error": "0.1"}, {"error": "0.3"}, {"error": "0.2"})
    assert cells_of(WIDE, found)[-1][:3] == ["cube", "1", "20.0 % (10.0 % to 30.0 %)"]
    found = rows_of("across", "b", {"speed": "2"}) + rows_of("across", "a", {"error": "0"})
    head, _, speed, error = cells_of(ACROSS, found)[:4]
    assert head[:4] == ["figure", "target", "a", "b"]
    assert speed[:4] == ["speed", "5", "", "2.0"] and error[:4] == ["error", "", "0.0 %", ""]


def test_reports_keep_sections_that_are_not_measured_again(tmp_path, monkeypatch):
    monkeypatch.setattr(tables, "RESULTS", tmp_path)
    tables.report("b", BENCH, rows_of("wide", "cube | 1", {"error": "0.1"}))
    text = tables.report("b", BENCH, rows_of("across", "a", {"speed": "2"}))
    assert text.count("## Wide") == text.count("## Across") == 1 and "10.0 %" in text
    assert text.count("here") == 2 and (tmp_path / "b.md").read_text() == text


def test_a_table_replaces_its_old_section_only_if_it_is_whole(tmp_path, monkeypatch):
    monkeypatch.setattr(tables, "RESULTS", tmp_path)
    both = [row for k, case in enumerate("ab") for row in rows_of("across", case, {"speed": k})]
    whole = tables.report("b", BENCH, both)
    text = tables.report("b", BENCH, rows_of("across", "a", {"speed": 7}))
    assert "0.0" in text and "7.0" in text and text.count("## Across") == 2
    assert tables.report("b", BENCH, both) == whole


def test_a_filter_that_matches_no_run_names_the_tables():
    result = CliRunner().invoke(run.main, ["boundaries", "--only", "vertical"])
    assert result.exit_code == 2 and "tables: slit, round," in result.output


def test_runs_are_resumed_and_failures_repeated(tmp_path, monkeypatch):
    """Without --resume, stored rows are measured again; rows of other cases are kept."""
    ran = []

    def fake(script, task, seconds):
        ran.append(task[1:4])
        return {"failure": "no room"} if task[2] == "b" else {"rows": [{"speed": 1.0}]}

    monkeypatch.setattr(run, "RESULTS", tmp_path)
    monkeypatch.setattr(run.rows, "in_process", fake)
    monkeypatch.setattr(tables, "bench_of", lambda name: BENCH)
    run.measure("b", ("across",), "", 2, False, "cpu", None)
    assert ran == [("across", c, k) for k in (0, 1) for c in ("a", "b")]
    known = rows.read(tmp_path / "b.csv")
    assert len(known) == 4 and [row.get("failure") for row in known[:2]] == [None, "no room"]
    run.measure("b", (), "", 2, True, "cpu", None)
    missing = [(t, case, k) for k in (0, 1) for t, case in (("wide", "cube | 1"), ("across", "b"))]
    assert ran[4:] == missing
    run.measure("b", ("acr",), "a", 1, False, "cpu", None)
    assert ran[8:] == [("across", "a", 0)] and len(rows.read(tmp_path / "b.csv")) == 6


@pytest.mark.parametrize("name", tables.MODULES)
def test_every_bench_has_runs_and_formats(name):
    """Every case is a function of a start, and labels have as many cells as the table has heads."""
    for key, table in tables.bench_of(name).tables.items():
        assert tables.tasks(tables.bench_of(name), (key,), "", None), key
        assert all(len(cells) == len(table.heads) or table.across for cells in table.cases), key
        assert set(table.targets) <= set(table.forms), key
        assert not set(tables.META) & set(table.forms), key


def test_slopes_and_layers_of_scale() -> None:
    """Exponents are fitted to large runs only, and finer pools have more layers."""
    sizes = [1e3, 1e4, 1e5, 1e6]
    assert abs(scale.slope(list(zip(sizes, [5.0, 1.0, 10.0, 100.0], strict=True))) - 1.0) < 1e-9
    layers = [scale.layers_of(n) for n in scale.ALONG]
    assert layers[0] >= 2 and layers == sorted(layers) and layers[-1] <= 16
    assert scale.scene_of(scale.LAYERED, 100).adaptation.capacity < 1_000_000 / 4


@pytest.mark.parametrize("drop", floating.KRAMER)
def test_potential_flow_has_the_measured_periods_of_heave(drop) -> None:
    """Regression: the time of the second crest, 2 % shorter by theory, was compared with measured
    periods, which are twice the time under water."""
    seconds = floating.DECAY
    heights = heave_theory.decay(drop, floating.RADIUS, floating.KRAMER_GRAVITY, seconds)
    found = floating.first_period(*heights)
    assert found == pytest.approx(floating.KRAMER[drop], rel=0.03)
    assert found[0] == pytest.approx(floating.KRAMER[drop][0], rel=0.01)


def test_images_fill_a_plane_body_exactly_and_a_ball_nearly() -> None:
    """Water beside a plane has its rest density, and a ball that is not small displaces its own
    volume in continuous water; where sheets of particles begin changes that by 0.5 %."""
    assert abs(displaced_volume.excess(0.5, 1e6)) < 1e-5
    assert abs(displaced_volume.force_error(4.0, convex=0.0)) < 3e-4
    near, far = (displaced_volume.force_error(4.0, first=first) for first in (0.4, 0.6))
    assert 0.005 < near - far < 0.008


@pytest.mark.parametrize(("window", "mean"), [(1.0, 4.0), (2.0, 4.0), (2.5, 3.2), (8.0, 1.0)])
def test_mean_pressures_are_over_the_whole_averaging_time(window, mean):
    readings = np.array([0.0, 0.0, 4.0, 4.0, 0.0])
    assert impact.highest_mean(readings, 1.0, window) == pytest.approx(mean)


def test_every_constant_that_is_varied_exists():
    """Regression: a constant that had been moved to another module ended the whole measurement."""
    named = [(module, name) for module, name, *_ in constants.TRIED if module != "scene"]
    for module, name in named:
        assert hasattr(importlib.import_module(constants.FLUID + module), name), (module, name)


@pytest.mark.parametrize("number", [8, 128, 706, 1575, 4703])
def test_splishsplash_blocks_have_the_exact_number_of_particles(number):
    """Regression: SPlisHSPlasH sorted surplus, inactive particles among the active."""
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
