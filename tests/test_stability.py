"""Tests of the hard cases, shortened: their requirements, and that a case can fail."""

import pytest

from bench import stability
from bench.hard_cases import CASES, Hard, short
from msph.scene.check import check


@pytest.mark.parametrize("name", CASES)
def test_cases_are_valid_scenes(name):
    check(CASES[name].build("projection"), name)


def test_pairs_at_one_position_pass():
    found = stability.run(short(CASES["pairs at one position"]), "projection")
    assert stability.violations(CASES["pairs at one position"], found) == []
    assert found["steps"] > 60 and found["density_end"] > 0.0


def test_violations_are_reported():
    case = CASES["pairs at one position"]
    found = stability.run(short(case), "classic")
    assert any(
        "energy" in problem or "density" in problem for problem in stability.violations(case, found)
    )


@pytest.mark.parametrize(
    ("figure", "value", "problem"),
    [
        ("outside", 2, "particles outside 2"),
        ("mass", 1e-3, "mass 0.001"),
        ("energy_rise", 0.01, "energy rise 0.01"),
        ("bulk_end", -0.02, "bulk density -0.02"),
        ("mass", float("nan"), "mass nan"),
        ("ended", "the water blew up: 3 of 9", "ended the water blew up: 3 of 9"),
    ],
)
def test_each_requirement_can_be_violated(figure, value, problem):
    good = {"ended": "finished", "outside": 0, "mass": 0.0, "energy_rise": 0.0, "kinetic": 1.0}
    good |= {"momentum_drift": 1e-7, "density_end": 1e-4, "bulk_end": float("nan")}
    assert stability.violations(Hard("rest"), good) == []
    assert stability.violations(Hard("rest"), {**good, figure: value}) == [problem]
    if figure == "ended":
        assert stability.violations(Hard("named", named="the water"), good) == ["ended finished"]
        assert stability.violations(Hard("named", named="the water"), {**good, figure: value}) == []
    else:
        named = {**good, "ended": "the water blew up", figure: value}
        kept = figure in ("energy_rise", "bulk_end")
        assert stability.violations(Hard("named", named="the water"), named) == (
            [problem] * (not kept)
        )


def test_failed_runs_are_rows_of_the_report():
    row = {"table": "cases", "case": "still | projection", "start": "0", "failure": "killed"}
    text = "\n".join(stability.verdict([row]))
    assert "passes 0 of 1" in text and "killed" in text
