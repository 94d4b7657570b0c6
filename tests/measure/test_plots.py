"""Plots of tables, and what is said where they cannot be drawn."""

import imageio.v2 as imageio
import numpy as np

from msph.measure import entry
from msph.measure.plots import plot
from msph.measure.survey import COLUMNS
from msph.measure.table import Table


def write_tables(folder, probes=("P1 [Pa]", "gauge [m]")):
    heads = entry.columns() + COLUMNS
    ledger = Table(folder / "ledger.csv", heads)
    readings = Table(folder / "probes.csv", ["time [s]", *probes])
    for k in range(20):
        ledger.write([0.1 * k, *np.linspace(0.1, 1.0, len(heads) - 1) * (k + 1)])
        readings.write([0.1 * k, *(np.nan if k == 0 else 1.0 * k for _ in probes)])


def test_ledger_and_probes_are_drawn(tmp_path):
    write_tables(tmp_path)
    files = plot(tmp_path, "water")
    assert [f.name for f in files] == ["ledger.png", "probes.png"]
    heights = []
    for file in files:
        picture = imageio.imread(file)[..., :3].astype(int)
        # Curves are what is neither white, black nor grey.
        coloured = np.ptp(picture, axis=2) > 60
        heights.append(len(picture))
        assert 500 < coloured.sum() < 0.2 * coloured.size
    # Six panels and two.
    assert heights[0] > 2.5 * heights[1]


def test_without_probes_there_is_one_plot(tmp_path):
    write_tables(tmp_path, probes=())
    assert [f.name for f in plot(tmp_path, "water")] == ["ledger.png"]
