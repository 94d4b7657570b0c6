"""Tests of values stored between runs, and of damaged or unwritable files."""

import pytest

from msph import user_cache
from msph.lesson.commands import Kept


def test_values_are_remembered_by_key(cache):
    assert user_cache.recall("lesson", int) is None
    user_cache.remember("lesson", 35)
    user_cache.remember("other", {"pool": 1.5})
    assert user_cache.recall("lesson", int) == 35
    assert user_cache.recall("other", dict[str, float]) == {"pool": 1.5}
    assert [p.name for p in cache.parent.iterdir()] == [cache.name]


@pytest.mark.parametrize("text", ["", "{", "[1, 2]", "null", "7", "[" * 100_000])
def test_a_damaged_file_is_reported_once_and_replaced(cache, text, capsys):
    cache.parent.mkdir()
    cache.write_text(text)
    assert user_cache.recall("lesson", int) is None
    assert user_cache.recall("lesson", int) is None
    assert capsys.readouterr().err == f"msph: {cache}: is damaged and is replaced\n"
    user_cache.remember("lesson", 35)
    assert user_cache.recall("lesson", int) == 35


@pytest.mark.parametrize("damaged", [7, None, {"ticked": 5}, {"answered": -1}, [[]]])
def test_a_damaged_value_is_reported_once_and_the_others_stay(cache, damaged, capsys):
    """Regression: {"lesson kernels": 7} stopped the list of lessons."""
    user_cache.remember("lesson", damaged)
    user_cache.remember("other", 35)
    for _ in range(2):
        assert user_cache.recall("lesson", Kept) is None
    assert "the value of 'lesson' is damaged" in capsys.readouterr().err
    assert user_cache.recall("other", int) == 35


def test_nothing_is_stored_without_a_writable_folder(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setattr(user_cache, "file", lambda: tmp_path / "file" / "measured.json")
    user_cache.remember("lesson", 35)
    assert user_cache.recall("lesson", int) is None
