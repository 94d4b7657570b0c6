"""Tests that a run continues without a cache folder that cannot be written, and says so once."""

import subprocess
import sys
from pathlib import Path

import pytest

from msph.cache_folder import TAICHI_FOLDER, ensure

NAMES = ("XDG_CACHE_HOME", "HOME", TAICHI_FOLDER)


@pytest.mark.skipif(sys.platform == "win32", reason="variables of POSIX")
@pytest.mark.parametrize(
    "given", [{}, {"XDG_CACHE_HOME": "file"}, {"HOME": "file"}, {TAICHI_FOLDER: "file"}]
)
def test_a_folder_that_cannot_be_written_is_replaced(given, tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    for name in NAMES:
        monkeypatch.delenv(name, raising=False)
        if name in given:
            monkeypatch.setenv(name, str(tmp_path / given[name]))
    told = []
    ensure(told.append)
    (line,) = told
    assert line.endswith("are not kept")
    ensure(told.append)
    assert len(told) == 1, "the substitute folder is writable"


# Script that runs a command, then compiles and launches a kernel.
RUN = """
from msph.cli import main
from msph.device import start
main(["scenes"])
start("cpu")
import taichi as ti
ti.field(ti.f32, 4).fill(1.0)
"""


def test_a_run_without_a_cache_exits_with_success(tmp_path):
    """A run whose cache folder cannot be written succeeds and reports this in one line.

    Regression: Taichi ended with a segmentation fault after the run.
    """
    (tmp_path / "file").write_text("")
    environment = {"XDG_CACHE_HOME": str(tmp_path / "file"), "PATH": "", "HOME": str(Path.home())}
    run = subprocess.run(
        [sys.executable, "-c", RUN],
        env=environment,
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert run.returncode == 0 and "Traceback" not in run.stderr
    assert "file/taichi: not a directory: compiled kernels" in run.stderr
