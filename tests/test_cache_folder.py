"""Tests that a run continues without a cache folder that cannot be written, and says so once."""

import subprocess
import sys
from pathlib import Path

import pytest

from msph.cache_folder import TAICHI_FOLDER, ensure
from tests.command_kit import python
from tests.tiers import slow_but

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
    """Regression: Taichi ended with a segmentation fault after the run."""
    (tmp_path / "file").write_text("")
    environment = {"XDG_CACHE_HOME": str(tmp_path / "file"), "PATH": "", "HOME": str(Path.home())}
    run = python("-c", RUN, env=environment)
    assert "Traceback" not in run.stderr
    assert "file/taichi: not a directory: compiled kernels" in run.stderr


# Script that compiles a kernel, or reads it from the cache.
KERNEL = """
from msph.device import start
start("cpu", 1)
import taichi as ti
@ti.kernel
def add(n: ti.i32) -> ti.i32:
    return n + 1
print(add(2))
"""


@pytest.mark.parametrize("kind", slow_but(["*.tic"], ["*.tic", "*.tcb"]))
def test_a_damaged_cache_is_removed_with_one_line(kind, tmp_path):
    """Regression: a run with a damaged cache ended with "basic_string::_M_replace_aux"."""
    script, cache = tmp_path / "add.py", tmp_path / "cache"
    script.write_text(KERNEL)
    environment = {"XDG_CACHE_HOME": str(cache), "PATH": "", "PYTHONPATH": str(Path.cwd())}
    said = []
    for _ in range(3):
        run = python(script, env=environment)
        assert run.stdout == "3\n"
        said.append(run.stderr.splitlines())
        if len(said) == 1:
            (file,) = cache.rglob(kind)
            content = bytearray(file.read_bytes())
            # Lengths of strings and tables.
            content[16:48] = b"\xff" * 32
            file.write_bytes(content)
    assert said[0] == said[2] == []
    assert len(said[1]) == 1 and said[1][0].endswith(
        "damaged kernels in the cache are compiled anew"
    )


@pytest.mark.skipif(sys.platform != "linux", reason="limits the address space")
def test_too_little_address_space_gives_one_line():
    """Regression: LLVM aborted without a message."""
    command = 'ulimit -v 600000; exec "$0" -m msph bench still --no-render'
    run = subprocess.run(
        ["bash", "-c", command, sys.executable], capture_output=True, text=True, timeout=100
    )
    assert run.returncode == 1
    (line,) = run.stderr.splitlines()
    assert line.endswith("(ulimit -v): the limit is 0.6 GiB")
