"""Tests that no command changes an existing file, whatever the names of its outputs."""

import contextlib
import tempfile
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msph import cli
from msph.errors import MsphError
from msph.stage import commands, loaded_scene
from tests.scenes_kit import GAUGE, TEXT, examples, write

SHORT = ("--set", "duration=0.04", "--set", "measure.every=0.02")
MEASURED = (
    *("ledger.csv", "probes.csv", "summary.json", "scene.toml", "checkpoint.npz"),
    *("ledger.png", "probes.png"),
)
# Arguments of each command, {} for the folder, and names of the files that the command writes.
COMMANDS = {
    "capture": (
        "capture {}/small.toml -o {}/small.png -o {}/a.mp4 -o {}/a.gif -o {}/f_%04d.png "
        "--mesh {}/m_%04d.ply --particles {}/p_%04d.npz --size 64x36 --fps 50",
        (
            *("small.png", "a.mp4", "a.gif", "small.scene.toml", "f_0000.png", "f_0001.png"),
            *("m_0000.ply", "m_0001.ply", "p_0000.npz", "p_0001.npz"),
        ),
    ),
    "measure": ("measure {}/small.toml -o {}", MEASURED),
    "bench": ("bench {}/small.toml --no-render --json {}/rows.json", ("rows.json",)),
    "page": ("lesson cubes --html {}", ("cubes.html",)),
    "slides": (
        "lesson kernels --slides {}",
        (*(f"kernels_{k:02d}.png" for k in range(1, 6)), "kernels_captions.txt"),
    ),
}


def decoys(names):
    """Returns names that a program might use for temporary files of these outputs."""
    return [made for n in names for made in (f"new_{n}", f".{n}", f"{n}.part", f"{n}.tmp", f"{n}~")]


@pytest.fixture(scope="module")
def one_folder(tmp_path_factory):
    return tmp_path_factory.mktemp("kept")


def run(command, folder, *more):
    short = SHORT if command in ("capture", "measure", "bench") else ()
    with contextlib.redirect_stdout(None):
        arguments = COMMANDS[command][0].format(*[folder] * 9).split()
        cli.cli.main([*arguments, *short, *more], standalone_mode=False)


def filled(folder, names):
    """Writes the scene and files of these names; returns all contents by path."""
    write(folder, TEXT + GAUGE)
    for name in names:
        (folder / name).write_text(f"a holiday: {name}")
    return {path: path.read_bytes() for path in folder.iterdir()}


def added(before, folder):
    """Returns the names of the new files; asserts that all earlier files are unchanged."""
    after = {path: path.read_bytes() for path in folder.iterdir()}
    assert before == {path: after.pop(path, None) for path in before}
    return {path.name for path in after}


@pytest.mark.parametrize("command", COMMANDS)
def test_files_with_names_similar_to_the_outputs_are_unchanged(command, tmp_path):
    names = COMMANDS[command][1]
    before = filled(tmp_path, decoys(names))
    run(command, tmp_path)
    assert added(before, tmp_path) == set(names)


@pytest.mark.parametrize("command", COMMANDS)
def test_an_existing_output_is_refused_and_nothing_is_written(command, tmp_path, monkeypatch):
    """Regression: the second of two `measure` runs to one folder was refused after its start."""
    if command in ("measure", "bench"):
        for module in (commands, loaded_scene):
            monkeypatch.setattr(module, "start", lambda *_: pytest.fail("has started"))
    for name in COMMANDS[command][1]:
        folder = tmp_path / name
        folder.mkdir()
        before = filled(folder, [name])
        with pytest.raises(MsphError, match="exists; --force overwrites it"):
            run(command, folder)
        assert added(before, folder) == set()


@examples(60)
@given(st.sampled_from(sorted(COMMANDS)), st.data())
def test_any_files_are_unchanged(one_folder, command, data):
    """An output with content exists, whatever other files exist."""
    names = COMMANDS[command][1]
    taken = data.draw(st.sets(st.sampled_from(names), min_size=1))
    beside = data.draw(st.sets(st.sampled_from(decoys(names)), max_size=6))
    folder = Path(tempfile.mkdtemp(dir=one_folder))
    filled(folder, ())
    for name in taken | beside:
        (folder / name).write_bytes(data.draw(st.binary(min_size=1, max_size=40)))
    before = {path: path.read_bytes() for path in folder.iterdir()}
    with pytest.raises(MsphError, match="exists; --force overwrites it"):
        run(command, folder)
    assert added(before, folder) == set()


def test_force_overwrites(tmp_path):
    write(tmp_path)
    (tmp_path / "rows.json").write_text("old")
    run("bench", tmp_path, "--force")
    assert "solver_residual" in (tmp_path / "rows.json").read_text()
