"""What is remembered between runs, and what happens where that is impossible."""

import pytest

from msph import user_cache


@pytest.fixture
def cache(tmp_path, monkeypatch):
    monkeypatch.setattr(user_cache, "file", lambda: tmp_path / "deeper" / "measured.json")
    return user_cache.file()


def test_values_are_remembered_by_key(cache):
    assert user_cache.recall("lesson", 7) == 7
    user_cache.remember("lesson", 35)
    user_cache.remember("other", {"pool": 1.5})
    assert user_cache.recall("lesson") == 35
    assert user_cache.recall("other") == {"pool": 1.5}
    assert [p.name for p in cache.parent.iterdir()] == [cache.name]


@pytest.mark.parametrize("text", ["", "{", "[1, 2]"])
def test_a_broken_file_holds_nothing(cache, text):
    cache.parent.mkdir()
    cache.write_text(text)
    assert user_cache.recall("lesson", 7) == 7
    user_cache.remember("lesson", 35)
    assert user_cache.recall("lesson") == 35


def test_where_nothing_can_be_written_nothing_is_remembered(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setattr(user_cache, "file", lambda: tmp_path / "file" / "measured.json")
    user_cache.remember("lesson", 35)
    assert user_cache.recall("lesson", 7) == 7
