"""Tests of plots of tables, and of their notes on gaps and negative pressures."""

import imageio.v2 as imageio
import numpy as np
import pytest

from msph.measure.entry import Entry
from msph.measure.plots import notes, plot
from msph.measure.survey import Survey
from msph.measure.table import Table


def write_tables(folder, probes=("P1 [Pa]", "gauge [m]")):
    heads = Entry.columns() + Survey.columns()
    ledger = Table(folder / "ledger.csv", heads)
    readings = Table(folder / "probes.csv", ["time [s]", *probes])
    for k in range(20):
        ledger.write([0.1 * k, *np.linspace(0.1, 1.0, len(heads) - 1) * (k + 1)])
        readings.write([0.1 * k, *(np.nan if k == 0 else 1.0 * k for _ in probes)])


def test_ledger_and_probes_are_plotted(tmp_path):
    write_tables(tmp_path)
    files = plot(tmp_path, "water")
    assert [f.name for f in files] == ["ledger.png", "probes.png"]
    heights = []
    for file in files:
        picture = imageio.imread(file)[..., :3].astype(int)
        # Pixels of curves are neither white, black nor grey.
        coloured = np.ptp(picture, axis=2) > 60
        heights.append(len(picture))
        assert 500 < coloured.sum() < 0.2 * coloured.size
    # The ledger has seven panels, the probes have two.
    assert heights[0] > 2.5 * heights[1]


def test_gaps_and_early_negative_pressures_are_explained():
    time = np.linspace(0.0, 2.0, 5)
    dry, early = np.array([np.nan, 1, 2, 3, 4]), np.array([-1.0, 1, 2, 3, 4])
    assert notes("pressure [Pa]", {"p": (time, np.abs(early))}) == []
    (line,) = notes("pressure [Pa]", {"p": (time, early), "q": (time, dry)})
    assert "no water" in line and "negative at first" in line
    assert notes("position [m]", {"x": (time, early)}) == []


@pytest.mark.filterwarnings("error", "ignore::DeprecationWarning")
def test_errors_of_zero_give_no_warning(tmp_path):
    """Regression: Matplotlib warned of a logarithmic axis without positive values."""
    heads = Entry.columns() + Survey.columns()
    ledger = Table(tmp_path / "ledger.csv", heads)
    Table(tmp_path / "probes.csv", ["time [s]"])
    for k in range(3):
        ledger.write([0.1 * k, *[0.0 if "error" in head else 1.0 for head in heads[1:]]])
    assert plot(tmp_path, "water")


def test_without_probes_there_is_one_plot(tmp_path):
    write_tables(tmp_path, probes=())
    assert [f.name for f in plot(tmp_path, "water")] == ["ledger.png"]
