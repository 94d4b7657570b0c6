"""The speed of this machine is measured once."""

from msph import user_cache
from msph.measure import machine_speed


def test_speed_is_measured_once_and_remembered(tmp_path, monkeypatch):
    monkeypatch.setattr(user_cache, "file", lambda: tmp_path / "measured.json")
    first = machine_speed.machine_speed("cpu")
    assert 1e6 < first < 1e13
    monkeypatch.setattr(machine_speed, "measured_speed", None)
    assert machine_speed.machine_speed("cpu") == first
