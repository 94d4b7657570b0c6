"""Tests of discretisation errors of values whose limit and order are known."""

import csv
import math

import numpy as np
import pytest

from msph.measure import convergence
from msph.measure.commands import SPLASH, available_energy
from msph.measure.convergence import RATIO, compare, estimate, factors
from msph.measure.entry import ENERGIES, WORKS
from msph.scene import load_scene


def values(order, runs=3):
    return [2.0 - 0.3 * f**order for f in factors(runs)]


@pytest.mark.parametrize("runs", [3, 4, 5])
@pytest.mark.parametrize("order", [1.0, 1.4, 2.0])
def test_order_limit_and_error_of_a_power_law_are_found(order, runs):
    found = estimate(values(order, runs))
    assert found.order == pytest.approx(order, abs=1e-4)
    assert found.limit == pytest.approx(2.0, abs=1e-4)
    assert found.error == pytest.approx(-0.3, abs=1e-4)
    assert found.uncertainty == pytest.approx(1.25 * 0.3, abs=1e-4)
    assert found.verdict == "in the asymptotic range"


def test_scatter_of_five_runs_is_fitted_by_least_squares():
    rng = np.random.default_rng(3)
    phi = np.array(values(1.5, 5)) + 1e-3 * rng.normal(size=5)
    found = estimate(phi)
    assert found.order == pytest.approx(1.5, abs=0.1) and found.limit == pytest.approx(
        2.0, abs=0.02
    )


@pytest.mark.parametrize(
    ("phi", "words"),
    [
        ([1.0, 1.4, 1.2], "oscillate"),
        ([1.0, 1.1, 1.4], "grow"),
        (values(0.4), "slower than first"),
        (values(5.0), "faster than second"),
        ([1.0, math.nan, 1.2], "unknown"),
    ],
)
def test_uncertainty_outside_the_asymptotic_range_is_at_least_the_differences(phi, words):
    found = estimate(phi)
    assert words in found.verdict and found.verdict != "in the asymptotic range"
    if np.isfinite(phi).all():
        assert found.uncertainty >= 1.25 * np.ptp(phi)


def test_equal_values_have_no_error():
    found = estimate([3.0, 3.0, 3.0])
    assert found.error == found.uncertainty == 0.0 and math.isnan(found.order)


def tables(order):
    """Returns ledgers and probes of runs in which the error of the height is of order h^order and a
    pressure oscillates from run to run."""
    time = np.linspace(0.0, 1.0, 11)
    ledgers, probes = [], []
    for k, f in enumerate(factors(3)):
        y = 0.3 - 0.1 * time + 0.01 * f**order * time
        ledger = {"centre_x_m": 0 * time, "centre_y_m": y, "centre_z_m": 1e-5 * time}
        ledger |= {f"{name}_J": 0 * time for name in (*ENERGIES, *WORKS)}
        ledger |= {"kinetic_J": time, "potential_J": y}
        ledgers.append(ledger)
        swinging = np.where(time > 0.0, 5.0 + (-1.0) ** k, np.nan)
        probes.append({"time_s": time, "P1_Pa": swinging})
    return ledgers, probes


def test_figures_of_runs_are_compared(tmp_path):
    rows = compare(*tables(1.5), spacing=0.01)
    found = {row.name: row for row in rows}
    # x and z of the centre move by less than 0.1 spacings and are left out.
    names = ["centre_y_mean", "kinetic_mean", "energy_lost", "P1_mean", "path_to_next_finer"]
    assert list(found) == names
    centre, path = found["centre_y_mean"].estimate, found["path_to_next_finer"].estimate
    assert centre.order == pytest.approx(1.5, abs=1e-3)
    assert centre.error == pytest.approx(0.01 * 0.5, abs=1e-5)
    assert path.order == pytest.approx(1.5, abs=1e-6)
    rms = math.sqrt(np.mean(np.linspace(0.0, 1.0, 11) ** 2))
    assert path.error == pytest.approx(0.01 * rms, rel=1e-6)
    assert found["P1_mean"].unit == "Pa" and "oscillate" in found["P1_mean"].estimate.verdict
    assert found["energy_lost"].values[-1] == pytest.approx(-1.0 + 0.1 - 0.01)
    convergence.write(tmp_path / "c.csv", rows, [0.02, 0.01 * RATIO, 0.01])
    with open(tmp_path / "c.csv", newline="") as file:
        spacing, *lines = csv.DictReader(file)
    assert float(spacing["run_3"]) == 0.01 and [line["quantity"] for line in lines] == names
    assert lines[3]["order"] == "" and float(lines[0]["order"]) == pytest.approx(1.5, abs=1e-3)
    assert convergence.text(rows, [0.02, 0.014, 0.01]).splitlines()[-1].startswith("3 of 5 figures")


def test_water_that_falls_is_told_from_water_at_rest():
    """`measure --converge` warns before runs of splashes, whose figures do not converge."""
    tank = {"box": {"size": (0.4, 0.4, 0.4)}, "layers": [{"spacing": 0.04}]}
    level, column = ({"lo": (0, 0, 0), "hi": (x, 0.2, 0.4)} for x in (0.4, 0.2))
    shares = [available_energy(load_scene({**tank, "water": [water]})) for water in (level, column)]
    assert shares[0] < SPLASH < shares[1]
