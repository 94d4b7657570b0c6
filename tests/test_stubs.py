"""Tests of stubs: a kernel of an earlier process is found without tracing it, and only if all that
the front end would read is the same."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from msph.stubs import RECORDS, SUFFIX
from msph.taichi_internals import PLAIN

pytestmark = pytest.mark.skipif(PLAIN, reason="plain Taichi has no stubs")

# Adds FACTOR times the length of a table, by an inlined function of another file, to a number.
PROGRAM = """
import sys
from msph.device import start
start("cpu", 1)
import taichi as ti
from msph import launches, stubs
import helper

FACTOR = 2.0

@launches.data_oriented
class Table:
    def __init__(self, size, padding):
        self.padding = ti.field(ti.i32, shape=padding)
        self.size, self.values = size, ti.field(ti.f32, shape=10)
        self.far = False

    @launches.kernel
    def total(self, first: ti.f32) -> ti.f32:
        found = first
        for k in range(ti.static(self.size)):
            self.values[k] = FACTOR
            found += helper.scaled(self.values[k])
        if ti.static(self.far):
            found += 1000.0
        return found

table = Table(int(sys.argv[1]), int(sys.argv[2]))
table.far = sys.argv[3] == "far"
traced = []
recorded, stubs.recorded = stubs.recorded, lambda reader: (traced.append(1), recorded(reader))[1]
print(table.total(1.0), len(traced))
"""
HELPER = """
import taichi as ti
from constants import SCALE, Number

@ti.func
def scaled(x):
    return SCALE * Number(value=x).value
"""
CONSTANTS = """
import taichi as ti
SCALE = 10.0
Number = ti.types.struct(value=ti.f32)
"""

PLUS_ONE = HELPER.replace(").value", ").value + 1.0")


class Program:
    """The program above in a folder, with a kernel cache of its own."""

    def __init__(self, folder: Path):
        self.folder, self.cache = folder, folder / "cache"
        self.cache.mkdir()
        for name, text in (("program", PROGRAM), ("helper", HELPER), ("constants", CONSTANTS)):
            self.write(name, text)

    def write(self, name: str, text: str) -> None:
        (self.folder / f"{name}.py").write_text(text)

    def run(self, size: int = 3, padding: int = 1, far: str = "near") -> tuple[float, bool]:
        """Returns the result, and whether a kernel was traced."""
        root = str(Path(__file__).parent.parent)
        result = subprocess.run(
            [sys.executable, "program.py", str(size), str(padding), far],
            cwd=self.folder,
            env={**os.environ, "TI_OFFLINE_CACHE_FILE_PATH": str(self.cache), "PYTHONPATH": root},
            capture_output=True,
            text=True,
            timeout=120,
        )
        assert result.returncode == 0, result.stderr
        total, traced = result.stdout.split()[-2:]
        return float(total), traced != "0"

    def stub(self) -> Path:
        """Returns the file of the only stub."""
        (path,) = (self.cache / RECORDS).iterdir()
        (record,) = json.loads(path.read_text())
        return self.cache / (record["stub"] + SUFFIX)


@pytest.fixture
def program(tmp_path: Path) -> Program:
    return Program(tmp_path)


def test_the_second_process_traces_nothing_until_a_constant_changes(program: Program) -> None:
    assert program.run() == (61.0, True)
    assert program.run() == (61.0, False)
    program.write("constants", CONSTANTS.replace("10.0", "100.0"))
    assert program.run() == (601.0, True)


def test_a_struct_type_of_another_file_makes_a_stub_stale(program: Program) -> None:
    """Regression: instances of Taichi's types counted as parts of Taichi."""
    program.run()
    program.write("constants", CONSTANTS.replace("value=ti.f32", "value=ti.i32"))
    assert program.run() == (61.0, True)


def test_kernels_that_read_the_same_have_a_stub_each(program: Program) -> None:
    """Regression: their stubs had one file, which held the code of the last."""
    head, end = PROGRAM.index("    @launches.kernel"), PROGRAM.index("table = Table")
    other = PROGRAM[head:end].replace("total", "rest").replace("found += h", "found -= h")
    text = PROGRAM[:end].rstrip() + "\n\n" + other + PROGRAM[end:]
    program.write("program", text.replace("table.total(1.0)", "table.total(1.0) + table.rest(1.0)"))
    assert [program.run(), program.run()] == [(2.0, True), (2.0, False)]


def test_another_copy_of_a_program_has_stubs_of_its_own(program: Program, tmp_path: Path) -> None:
    """Regression: a copy found the kernel of the other copy, whose files had not changed."""
    (tmp_path / "copy").mkdir()
    copy = Program(tmp_path / "copy")
    copy.cache = program.cache
    copy.write("helper", PLUS_ONE)
    assert program.run() == (61.0, True)
    assert copy.run() == (64.0, True)
    assert [program.run(), copy.run()] == [(61.0, False), (64.0, False)]


@pytest.mark.slow
def test_whatever_the_front_end_reads_makes_a_stub_stale(program: Program) -> None:
    program.run()
    assert program.run(size=4) == (81.0, True)
    assert program.run(far="far") == (1061.0, True)
    assert program.run(padding=7) == (61.0, True)
    assert program.run(padding=7) == (61.0, False)
    assert program.run() == (61.0, False)
    program.write("helper", PLUS_ONE)
    assert program.run() == (64.0, True)
    program.write("program", PROGRAM.replace("FACTOR = 2.0", "FACTOR = 3.0"))
    assert program.run() == (94.0, True)


@pytest.mark.slow
def test_a_stub_with_other_contents_is_not_used(program: Program, tmp_path: Path) -> None:
    (tmp_path / "other").mkdir()
    other = Program(tmp_path / "other")
    other.run(size=4)
    program.run()
    intact = program.stub().read_bytes()
    program.stub().write_bytes(intact[:100])
    assert program.run() == (61.0, True)
    assert program.stub().read_bytes() == intact
    program.stub().write_bytes(other.stub().read_bytes())
    assert program.run() == (61.0, True)
    program.stub().unlink()
    assert program.run() == (61.0, True)
    assert program.run() == (61.0, False)
    (path,) = (program.cache / RECORDS).iterdir()
    path.write_bytes(b"[{")
    assert program.run() == (61.0, True)


def test_a_kernel_that_calls_a_function_of_python_has_no_stub(program: Program) -> None:
    text = PROGRAM.replace("ti.static(self.size)", "ti.static(self.count())").replace(
        "    @launches.kernel",
        "    def count(self):\n        return self.size\n\n    @launches.kernel",
    )
    program.write("program", text)
    assert [program.run(), program.run()] == [(61.0, True), (61.0, True)]
