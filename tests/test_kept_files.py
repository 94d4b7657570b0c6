"""No command changes a byte of a file that existed before it, whatever its outputs are called."""

import contextlib
import tempfile
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from msph import cli
from msph.errors import MsphError
from msph.lesson import commands as lesson_commands
from msph.stage import commands
from tests.scenes_kit import TEXT, write

SCENE = f"""{TEXT}
[[probes]]
name = "gauge"
kind = "height"
at = [0.2, 0.2]
"""
SHORT = ("--set", "duration=0.04", "--set", "measure.every=0.02")
MEASURED = (
    *("ledger.csv", "probes.csv", "summary.json", "scene.toml", "checkpoint.npz"),
    *("ledger.png", "probes.png"),
)
# Arguments by command, {} the folder, and files that it writes.
COMMANDS = {
    "capture": (
        "capture {}/small.toml -o {}/a.png -o {}/a.mp4 -o {}/a.gif -o {}/f_%04d.png "
        "--mesh {}/m_%04d.ply --particles {}/p_%04d.npz --size 64x36 --fps 50",
        (
            *("a.png", "a.mp4", "a.gif", "a.scene.toml", "f_0000.png", "f_0001.png"),
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
    """Names that a careless writer might use on the way to its outputs."""
    return [made for n in names for made in (f"new_{n}", f".{n}", f"{n}.part", f"{n}.tmp", f"{n}~")]


@pytest.fixture(autouse=True, scope="module")
def one_taichi():
    with pytest.MonkeyPatch.context() as patch:
        for module in (commands, lesson_commands):
            patch.setattr(module, "start", lambda arch, threads: "cpu")
        yield


@pytest.fixture(scope="module")
def one_folder(tmp_path_factory):
    return tmp_path_factory.mktemp("kept")


def run(command, folder):
    short = SHORT if command in ("capture", "measure", "bench") else ()
    with contextlib.redirect_stdout(None):
        arguments = COMMANDS[command][0].format(*[folder] * 9).split()
        cli.cli.main([*arguments, *short], standalone_mode=False)


def filled(folder, names):
    """Contents by path: the scene, and files of these names."""
    write(folder, SCENE)
    for name in names:
        (folder / name).write_text(f"a holiday: {name}")
    return {path: path.read_bytes() for path in folder.iterdir()}


def added(before, folder):
    """Names of the files that are new; those that were there are unchanged."""
    after = {path: path.read_bytes() for path in folder.iterdir()}
    assert before == {path: after.pop(path, None) for path in before}
    return {path.name for path in after}


@pytest.mark.parametrize("command", COMMANDS)
def test_files_beside_those_that_are_written_are_unchanged(command, tmp_path):
    names = COMMANDS[command][1]
    before = filled(tmp_path, decoys(names))
    run(command, tmp_path)
    assert added(before, tmp_path) == set(names)


@pytest.mark.parametrize("command", COMMANDS)
def test_a_name_that_is_taken_is_refused_and_nothing_is_written(command, tmp_path):
    for name in COMMANDS[command][1]:
        folder = tmp_path / name
        folder.mkdir()
        before = filled(folder, [name])
        with pytest.raises(MsphError, match="exists; --force overwrites it"):
            run(command, folder)
        assert added(before, folder) == set()


@settings(deadline=None, derandomize=True, max_examples=60)
@given(st.sampled_from(sorted(COMMANDS)), st.data())
def test_any_files_are_unchanged(one_folder, command, data):
    """Any set of files of any content, among them an output: the command is refused."""
    names = COMMANDS[command][1]
    taken = data.draw(st.sets(st.sampled_from(names), min_size=1))
    beside = data.draw(st.sets(st.sampled_from(decoys(names)), max_size=6))
    folder = Path(tempfile.mkdtemp(dir=one_folder))
    filled(folder, ())
    for name in taken | beside:
        (folder / name).write_bytes(data.draw(st.binary(max_size=40)))
    before = {path: path.read_bytes() for path in folder.iterdir()}
    with pytest.raises(MsphError, match="exists; --force overwrites it"):
        run(command, folder)
    assert added(before, folder) == set()


def test_force_overwrites(tmp_path):
    write(tmp_path)
    (tmp_path / "rows.json").write_text("old")
    text = COMMANDS["bench"][0].format(*[tmp_path] * 9).split()
    cli.cli.main([*text, *SHORT, "--force"], standalone_mode=False)
    assert "solver_residual" in (tmp_path / "rows.json").read_text()
