"""Tests of the error table: errors outside their limits give cautions, unknown errors do not."""

import math

from msph.measure import account

GOOD = {
    "spacings_across_depth": 20.0,
    "spacings_across_bodies.0": 5.0,
    "mass_change": -1e-9,
    "outside_most": 0,
    "solver_residual_mean": 0.001,
    "volume_error_worst": -0.001,
    "bulk_density_error_mean": math.nan,
}
WATER = {"mass_laid_kg": 1.0, "mass_asked_kg": 1.0}


def test_a_good_run_has_no_cautions():
    lines = account.account(GOOD)
    assert {line.key for line in lines} == set(GOOD)
    assert account.cautions(lines) == []
    text = account.text(lines, [], WATER)
    assert "all within their limits" in text and "outside\n" not in text
    assert "unknown" in next(row for row in text.splitlines() if "bulk density" in row)


def test_every_error_outside_its_limit_gives_a_caution():
    """Values below a lower limit, and values of either sign beyond an upper limit, give a caution
    each; each body is judged and named separately."""
    bad = {
        "spacings_across_depth": 4.0,
        "spacings_across_bodies.0": 1.0,
        "spacings_across_bodies.1": 9.0,
        "mass_change": -0.1,
        "outside_most": 3,
        "volume_error_worst": -0.08,
    }
    lines = account.account(bad)
    notes = account.cautions(lines, "surface mesh overflow: 9 triangles wanted, 8 fit")
    assert len(notes) == 5
    assert any(note.startswith("across bodies.0: 1.0 (limit >= 1.45): ") for note in notes)
    assert any("-8.000 %" in note and note.endswith("9 triangles wanted, 8 fit") for note in notes)
    text = account.text(lines, notes, WATER)
    assert text.count("outside\n") == text.count("caution: ") == 5
