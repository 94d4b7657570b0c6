"""Tests of output files: existing files are not changed, and written files are complete."""

import errno
import os
import subprocess
import sys
import time

import pytest

from msph import own_files
from msph.errors import LostOutputError
from msph.own_files import (
    ExistingFileError,
    OutputError,
    claim,
    free_stem,
    replace,
    replacing,
    writing,
    written,
)


@pytest.fixture(autouse=True)
def command():
    own_files.release()


# Script of a process that claims the same files as others at the same time. It runs until its
# standard input ends, since empty files of a process that has ended are free.
RIVAL = """
import sys, time
from pathlib import Path
from msph.own_files import ExistingFileError, claim, free_stem
folder, begin = Path(sys.argv[1]), float(sys.argv[2])
time.sleep(max(0.0, begin - time.time()))
won = 0
for k in range(200):
    try:
        claim([folder / f"{k}_{n}" for n in "ba"])
        won += 1
    except ExistingFileError:
        pass
print(won, *(free_stem(folder, "pool") for _ in range(20)), flush=True)
sys.stdin.read()
"""


def test_of_processes_that_claim_the_same_files_one_succeeds(tmp_path):
    """Regression: two captures started in one folder wrote the same files without an error."""
    run = [sys.executable, "-c", RIVAL, str(tmp_path), str(time.time() + 1.0)]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    rivals = [subprocess.Popen(run, text=True, **pipes) for _ in range(3)]
    found = [rival.stdout.readline().split() for rival in rivals]
    for rival in rivals:
        rival.communicate(timeout=60)
    assert sum(int(won) for won, *_ in found) == 200
    stems = [stem for _, *own in found for stem in own]
    assert len(stems) == len(set(stems)) == 60


def test_files_of_a_killed_command_are_free_and_those_of_a_running_one_are_not(tmp_path):
    """Regression: empty files of a killed command were refused without --force."""
    holder = RIVAL.split("time.sleep")[0] + "claim([folder / 'a.png']); print(1, flush=True); "
    run = [sys.executable, "-c", holder + "time.sleep(60)", str(tmp_path), "0"]
    with subprocess.Popen(run, stdout=subprocess.PIPE) as other:
        other.stdout.readline()
        with pytest.raises(ExistingFileError):
            claim([tmp_path / "b.png", tmp_path / "a.png"])
        other.kill()
        other.wait()
    assert (tmp_path / "a.png").read_bytes() == b""
    claim([tmp_path / "a.png"])
    own_files.release()
    assert not any(tmp_path.iterdir())


def test_files_that_are_claimed_and_not_written_are_removed(tmp_path):
    empty, full, frame = (tmp_path / name for name in ("deep/a.png", "b.json", "f_1.png"))
    claim([empty, full], later=[frame])
    assert empty.is_file() and not written(empty) and not frame.exists()
    replace(full, "1")
    own_files.release()
    assert [p.name for p in tmp_path.iterdir() if p.is_file()] == ["b.json"]
    with pytest.raises(ExistingFileError):
        claim([empty], later=[full])
    assert not empty.exists()


def test_files_that_cannot_be_written_are_refused(tmp_path):
    """Regression: a loop of symbolic links gave an unexpected error."""
    (tmp_path / "file").touch()
    os.symlink(tmp_path / "b.png", tmp_path / "a.png")
    os.symlink(tmp_path / "a.png", tmp_path / "b.png")
    for name, problem in (
        ("file/a.mp4", "file: is a file, not a folder"),
        ("a.png", "a.png: too many levels of symbolic links"),
        ("nul\0.png", "is not a file name"),
        ("x" * 300, "file name too long"),
    ):
        with pytest.raises(OutputError, match=problem):
            claim([tmp_path / name], force=True)


def test_a_file_that_existed_before_is_refused_unless_forced(tmp_path):
    other, path = tmp_path / "a.png", tmp_path / "b.png"
    path.write_text("a holiday")
    with pytest.raises(ExistingFileError, match=r"b\.png: exists"):
        claim([other, path])
    assert not other.exists()
    other.write_text("came meanwhile")
    with pytest.raises(ExistingFileError):
        replace(other, "frames")  # a refused claim claims nothing
    with pytest.raises(ExistingFileError), writing(path):
        path.write_text("frames")
    with pytest.raises(ExistingFileError):
        replace(path, "frames")
    assert path.read_text() == "a holiday"
    claim([path], force=True)
    replace(path, "frames")
    assert path.read_text() == "frames"


def test_a_command_may_write_its_own_file_again(tmp_path):
    path = tmp_path / "a.json"
    replace(path, "1")
    replace(path, "2")
    own_files.release()
    with pytest.raises(ExistingFileError):
        replace(path, "3")
    assert path.read_text() == "2"


def test_a_temporary_file_has_an_unused_name(tmp_path):
    """Regression: a user's file named new_NAME was overwritten and removed."""
    taken = tmp_path / "new_a.json"
    taken.write_text("a holiday")
    with replacing(tmp_path / "a.json") as temporary:
        assert temporary.parent == tmp_path and temporary.suffix == ".json"
        temporary.write_text("1")
    assert taken.read_text() == "a holiday"
    assert {p.name for p in tmp_path.iterdir()} == {"a.json", "new_a.json"}


def test_files_have_the_permissions_of_the_user(tmp_path):
    replace(tmp_path / "a.json", "1")
    (tmp_path / "b.json").write_text("1")
    assert (tmp_path / "a.json").stat().st_mode == (tmp_path / "b.json").stat().st_mode


def test_a_symbolic_link_remains_a_link(tmp_path):
    (tmp_path / "target.json").write_text("old")
    os.symlink(tmp_path / "target.json", tmp_path / "a.json")
    claim([tmp_path / "a.json"], force=True)
    replace(tmp_path / "a.json", "new")
    assert (tmp_path / "a.json").is_symlink()
    assert (tmp_path / "target.json").read_text() == "new"


def test_free_stems_are_numbered(tmp_path):
    for name in ("pool.mp4", "pool_2.scene.toml"):
        (tmp_path / name).write_text("")
    assert free_stem(tmp_path, "pool") == "pool_3"
    assert free_stem(tmp_path, "pool") == "pool_4"
    own_files.release()
    assert free_stem(tmp_path, "pool") == "pool_3"


def test_a_full_disk_is_reported_and_leaves_no_partial_file(tmp_path):
    """Regression: a partial checkpoint was left, and the error named no file."""
    path = tmp_path / "checkpoint.npz"
    replace(path, "old")
    message = r"checkpoint\.npz: no space left on device"
    with pytest.raises(LostOutputError, match=message), replacing(path) as new:
        new.write_text("half")
        raise OSError(errno.ENOSPC, "No space left on device")
    assert [p.name for p in tmp_path.iterdir()] == ["checkpoint.npz"]
    assert path.read_text() == "old"
