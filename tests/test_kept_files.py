"""No command changes a byte of a file that existed before it, whatever its outputs are called."""

import contextlib

import pytest
from hypothesis import HealthCheck, given, settings
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
    "page": ("lesson kernels --html {}", ("kernels.html",)),
    "slides": (
        "lesson kernels --slides {}",
        (*(f"kernels_{k:02d}.png" for k in range(1, 6)), "kernels_captions.txt"),
    ),
}


def decoys(names):
    """Names that a careless writer might use on the way to its outputs."""
    return [made for n in names for made in (f"new_{n}", f".{n}", f"{n}.part", f"{n}.tmp", f"{n}~")]


@st.composite
def situations(draw):
    command = draw(st.sampled_from(sorted(COMMANDS)))
    names = COMMANDS[command][1]
    taken = draw(st.sets(st.sampled_from(names), max_size=2))
    return command, taken, draw(st.sets(st.sampled_from(decoys(names)), max_size=4))


@pytest.fixture(autouse=True)
def one_taichi(monkeypatch):
    for module in (commands, lesson_commands):
        monkeypatch.setattr(module, "start", lambda arch, threads: "cpu")


@settings(
    max_examples=15,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(situations())
def test_what_existed_before_is_unchanged(tmp_path_factory, situation):
    command, taken, others = situation
    folder = tmp_path_factory.mktemp("before")
    text, names = COMMANDS[command]
    write(folder, SCENE)
    before = {folder / name: f"a holiday: {name}".encode() for name in taken | others}
    before[folder / "small.toml"] = (folder / "small.toml").read_bytes()
    for path, content in before.items():
        path.write_bytes(content)
    short = SHORT if command in ("capture", "measure", "bench") else ()
    refused = False
    try:
        with contextlib.redirect_stdout(None):
            cli.cli.main([*text.format(*[folder] * 9).split(), *short], standalone_mode=False)
    except MsphError as error:
        assert "exists; --force overwrites it" in str(error)
        refused = True
    assert refused == bool(taken)
    for path, content in before.items():
        assert path.read_bytes() == content
    left = {path.name for path in folder.iterdir()} - {path.name for path in before}
    assert left == (set() if refused else set(names))


def test_force_overwrites(tmp_path):
    write(tmp_path)
    (tmp_path / "rows.json").write_text("old")
    text = COMMANDS["bench"][0].format(*[tmp_path] * 9).split()
    cli.cli.main([*text, *SHORT, "--force"], standalone_mode=False)
    assert "density_error" in (tmp_path / "rows.json").read_text()
