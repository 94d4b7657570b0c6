"""The sweep of speed against error: its cases at sizes that take seconds, and how it is read."""

import dataclasses

import numpy as np
import pytest

from bench import pareto, pareto_report, pareto_table, rows
from bench.cases import CASES
from bench.cases.case import ADAPTIVE, UNIFORM, Setting
from bench.cases.dam_break import reference


@pytest.fixture(scope="module")
def slosh():
    return CASES["sloshing"].measure(Setting(water=ADAPTIVE, fineness=6))


def test_a_case_is_measured_against_its_formula(slosh):
    """Six spacings: the wave is damped and late, but it is a wave."""
    run, errors = slosh
    assert set(errors) == set(CASES["sloshing"].errors)
    assert errors["period"] < 0.2 and errors["height"] < 0.02
    assert 0.05 < errors["wave"] < 1.0
    costs = run.costs()
    assert costs["particles"] < 6 * 12 * 4 and costs["steps"] >= 60 * run.simulated
    assert costs["wall_per_simulated"] > 0.0 and costs["peak_mib"] > 50.0


def test_momenta_of_a_collision_are_kept():
    _, errors = CASES["collision"].measure(Setting(water=ADAPTIVE, fineness=3))
    assert errors["mass"] < 1e-6 and errors["momentum"] < 1e-5 and errors["angular_momentum"] < 1e-3


def test_a_dam_break_is_read_against_the_experiment():
    """Four spacings wide; height and front within a tenth."""
    _, errors = CASES["dam_break"].measure(Setting(fineness=4))
    assert errors["front"] < 0.1 and errors["height"] < 0.1
    assert errors["beyond_ritter"] == 0.0


@pytest.mark.parametrize("name", ["front", "height"])
def test_references_are_in_order(name):
    times, places = reference(name)
    assert np.all(np.diff(times) > 0.0)
    assert np.all(np.diff(places) > 0.0) or np.all(np.diff(places) < 0.0)


@pytest.mark.parametrize("case", CASES.values(), ids=lambda case: case.name)
def test_sweeps_have_no_row_twice(case):
    for quick in (True, False):
        settings = case.settings(quick)
        assert len(set(settings)) == len(settings) > (0 if quick else 1)
    assert {UNIFORM, "system-1"} & {s.water for s in settings}


def row(case, time, error, **more):
    setting = Setting(**more)
    found = {"wall_per_simulated": time, CASES[case].main: error}
    return pareto_table.row_of(case, setting, "cpu", found)


def test_rows_that_are_dominated_are_left_out():
    found = [row("sloshing", *pair) for pair in ((1.0, 0.1), (2.0, 0.2), (3.0, 0.01), (4.0, 0.01))]
    best = pareto_report.undominated(found, "wave")
    assert [pareto_table.number(r, "wave") for r in best] == [0.1, 0.01]


def test_time_at_equal_error_is_read_between_rows():
    found = [row("sloshing", 1.0, 0.1), row("sloshing", 100.0, 0.001, fineness=20)]
    found.append(row("sloshing", 2.0, 0.01, water=ADAPTIVE))
    words = pareto_report.ratio_at_equal_error(found, CASES["sloshing"])
    assert "wave 5" in words


def test_orders_of_convergence():
    assert pareto_report.slope([5, 10, 20], [0.4, 0.1, 0.025]).startswith("2.0")


def test_a_sweep_goes_on_where_it_was(tmp_path, monkeypatch):
    """A row that is in the table is not run again; one that fails is in the table, and said."""
    monkeypatch.setattr(pareto, "RESULTS", tmp_path)
    ran = []

    def fake(case, setting, arch):
        ran.append(setting)
        if setting["water"] == ADAPTIVE:
            return {"failure": "no room"}
        return {"wall_per_simulated": 1.0, CASES[case].main: 0.1}

    monkeypatch.setattr(pareto, "in_process", fake)
    pareto.sweep(("sloshing",), True, [], "cpu", "")
    whole = len(ran)
    assert whole == len(CASES["sloshing"].settings(True))
    known = rows.read(tmp_path / pareto.TABLE)
    assert len(known) == whole
    pareto.sweep(("sloshing",), True, known[:-2], "cpu", "")
    assert len(ran) == whole + 2
    assert ran[-1] == dataclasses.asdict(CASES["sloshing"].settings(True)[-1])
    disturbed = [{**known[0], "others": "0.5"}, *known[1:]]
    pareto.sweep(("sloshing",), True, disturbed, "cpu", "")
    assert len(ran) == whole + 3 and len(disturbed) == whole
    pareto_report.report(known, tmp_path)
    text = (tmp_path / "pareto.md").read_text()
    assert "failed: no room" in text and (tmp_path / "pareto_sloshing.png").exists()
