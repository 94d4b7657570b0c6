"""Tests of tables: names of columns, and the continuation of an existing table."""

import errno

import numpy as np
import pytest

from msph.errors import LostOutputError
from msph.measure.entry import Entry, energy_less_work
from msph.measure.table import Table, TableError, column, read


class HalfAWriter:
    """Replacement of csv.writer that fails after the first cell of a row, as on a full disk."""

    def __init__(self, file, **_):
        self.file = file

    def writerow(self, cells):
        self.file.write(cells[0])
        self.file.flush()
        raise OSError(errno.ENOSPC, "No space left on device")


def test_a_full_disk_leaves_whole_rows(tmp_path, monkeypatch):
    table = Table(tmp_path / "t.csv", ["time [s]", "height [m]"])
    table.write([0.0, 1.0])
    whole = table.path.read_text()
    monkeypatch.setattr("msph.measure.table.csv.writer", HalfAWriter)
    with pytest.raises(LostOutputError, match=r"t\.csv: no space left on device"):
        table.write([0.5, 1.0])
    assert table.path.read_text() == whole


@pytest.mark.parametrize(
    ("head", "name"),
    [
        ("pressure [Pa]", "pressure_Pa"),
        ("bulk_density_mean [-]", "bulk_density_mean"),
        ("gravity_y [m/s^2]", "gravity_y_m_per_s2"),
        ("angular_momentum_z [kg m^2/s]", "angular_momentum_z_kg_m2_per_s"),
        ("volume [m^3]", "volume_m3"),
        ("rate [1/s]", "rate_per_s"),
    ],
)
def test_a_columns_name_ends_in_its_unit(head, name):
    assert column(head) == name


HEADS = ["time [s]", "P1 [Pa]"]


def written(path, rows, **options):
    table = Table(path, HEADS, **options)
    for row in rows:
        table.write(row)
    return table


def test_a_table_continues_from_the_time_of_a_checkpoint(tmp_path):
    path = tmp_path / "probes.csv"
    written(path, [(0.0, np.nan), (0.1, 5.0), (0.2, 7.0)])
    table = written(path, [(0.2, 8.0)], until=0.1)
    assert table.kept.shape == (2, 2)
    found = read(path)
    assert list(found) == ["time_s", "P1_Pa"]
    assert found["time_s"].tolist() == [0.0, 0.1, 0.2]
    assert found["P1_Pa"].tolist()[1:] == [5.0, 8.0] and np.isnan(found["P1_Pa"][0])
    written(path, [], until=0.1)
    assert len(read(path)["time_s"]) == 3
    written(path, [])
    assert path.read_text() == "time_s,P1_Pa\n"


def test_a_table_of_other_columns_is_refused_and_kept(tmp_path):
    path = tmp_path / "probes.csv"
    path.write_text("time_s,P2_Pa\n0,1\n")
    with pytest.raises(TableError, match="its columns differ from this run's"):
        written(path, [], until=1.0)
    assert path.read_text() == "time_s,P2_Pa\n0,1\n"


def test_the_energy_of_a_table_equals_the_energy_of_its_entries(tmp_path):
    """Regression: plots and convergence studies left out inflows, outflows and spilt water."""
    path, heads = tmp_path / "ledger.csv", Entry.columns()
    ledger = Table(path, heads)
    ledger.write(range(1, len(heads) + 1))
    table = read(path)
    found = Entry.of(np.column_stack(list(table.values()))[0])
    assert energy_less_work(table) == pytest.approx([found.energy])
