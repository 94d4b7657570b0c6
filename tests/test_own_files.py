"""Files of runs and files of others."""

import errno

import pytest

from msph.errors import LostOutputError
from msph.own_files import (
    ForeignFileError,
    check_overwrite,
    is_unmodified,
    replace,
    replacing,
    with_digest,
)


def test_a_runs_scene_is_told_from_an_edited_one(tmp_path):
    scene, output = tmp_path / "a.scene.toml", tmp_path / "a.mp4"
    check_overwrite(scene, [output], force=False)
    replace(scene, with_digest("seed = 1\n"))
    output.write_text("frames")
    assert is_unmodified(scene) and not is_unmodified(output)
    check_overwrite(scene, [output], force=False)
    scene.write_text(scene.read_text().replace("1", "2"))
    with pytest.raises(ForeignFileError, match=r"a\.scene\.toml: was not written by a run"):
        check_overwrite(scene, [output], force=False)
    check_overwrite(scene, [output], force=True)


def test_an_output_without_a_runs_scene_is_somebodys(tmp_path):
    output = tmp_path / "a.mp4"
    output.write_text("a holiday")
    with pytest.raises(ForeignFileError, match=r"a\.mp4: was not written"):
        check_overwrite(tmp_path / "a.scene.toml", [output], force=False)


def test_a_write_that_fails_leaves_what_there_was(tmp_path):
    path = tmp_path / "a.json"
    replace(path, "old")
    with pytest.raises(UnicodeEncodeError):
        replace(path, "new \ud800")
    assert path.read_text() == "old"


def test_a_disk_that_fills_is_said_and_leaves_no_part(tmp_path):
    """A part of a checkpoint was left, and the error named no file."""
    path = tmp_path / "checkpoint.npz"
    path.write_text("old")
    message = r"checkpoint\.npz: no space left on device"
    with pytest.raises(LostOutputError, match=message), replacing(path) as new:
        new.write_text("half")
        raise OSError(errno.ENOSPC, "No space left on device")
    assert [p.name for p in tmp_path.iterdir()] == ["checkpoint.npz"]
    assert path.read_text() == "old"
