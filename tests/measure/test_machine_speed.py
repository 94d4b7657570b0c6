"""The speed of this machine is measured a few times and remembered."""

from msph import user_cache
from msph.measure import machine_speed
from msph.measure.machine_speed import STARTS


def test_a_speed_is_measured():
    assert 1e6 < machine_speed.measured_speed() < 1e13


def test_the_fastest_of_the_first_starts_is_remembered(tmp_path, monkeypatch):
    monkeypatch.setattr(user_cache, "file", lambda: tmp_path / "measured.json")
    speeds = iter([2e9, 1e9, 3e9, 1e9, 2e9, 9e9])
    monkeypatch.setattr(machine_speed, "measured_speed", lambda: next(speeds))
    found = [machine_speed.machine_speed("cpu") for _ in range(STARTS + 2)]
    assert found == [2e9, 2e9, 3e9, 3e9, 3e9, 3e9, 3e9]
