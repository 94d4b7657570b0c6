"""Tests that fast launches give the same results as plain Taichi, which is the fallback."""

import ast
import contextlib
import inspect
import math
import os

import numpy as np
import pytest
import taichi as ti
from taichi.lang.kernel_impl import Kernel

from msph import launches
from msph.launches import (
    BLOCKS,
    FEW,
    FEW_BLOCKS,
    MOST_SERIAL,
    Traits,
    data_oriented,
    heavy_kernel,
    kernel,
    run_in_steps,
    use_traits,
    watch_compiling,
)
from msph.taichi_internals import EQUAL_PARTS, GRID, PLAIN, SWITCH, _in_class_body, _source_lines
from tests.command_kit import python

SIZE = 8
fast_only = pytest.mark.skipif(PLAIN, reason="kernels are Taichi's own")


@data_oriented
class Scaled:
    """Fields, and kernels that use this object's `factor`, fields, numbers and arrays."""

    def __init__(self, factor: float):
        self.factor = factor
        self.one, self.other = (ti.field(ti.f32, shape=SIZE) for _ in range(2))

    @kernel
    def fill(self, count: ti.i32, target: ti.template(), negative: ti.template(), value: ti.f32):
        for i in range(count):
            target[i] = self.factor * (-value if ti.static(negative) else value)

    @heavy_kernel
    def double(self, count: ti.i32):
        for i in range(count):
            self.other[i] = 2.0 * self.one[i]

    @kernel
    def total(self, count: ti.i32) -> ti.f32:
        found = 0.0
        for i in range(count):
            found += self.one[i]
        return found

    @kernel
    def ends(self, count: ti.i32) -> ti.math.vec2:
        return ti.Vector([self.one[0], self.one[count - 1]])

    @kernel
    def wet(self, level: ti.f32) -> ti.i32:
        found = 0
        for i in range(SIZE):
            found += ti.select(self.one[i] > level, 1, 0)
        return found

    @kernel
    def place(self, target: ti.template(), start: ti.i32, v: ti.math.vec3, cell: ti.math.ivec3):
        for k in ti.static(range(3)):
            target[start + k] = self.factor * v[k]
            target[start + 3 + k] = ti.cast(cell[k], ti.f32)

    @kernel
    def load(self, values: ti.types.ndarray(dtype=ti.f32, ndim=1)):
        for i in range(SIZE):
            self.one[i] = values[i]


@pytest.fixture(scope="module")
def pair() -> tuple[Scaled, Scaled]:
    return Scaled(2.0), Scaled(3.0)


def test_each_launch_uses_its_own_numbers_templates_and_object(pair) -> None:
    two, three = pair
    for value, count in ((1.5, 8), (0.25, 3), (-4.0, 5)):
        for scaled in pair:
            for field, sign in ((scaled.one, 1.0), (scaled.other, -1.0)):
                field.fill(7.0)
                scaled.fill(count, field, sign < 0.0, value)
                expected = [sign * scaled.factor * value] * count + [7.0] * (SIZE - count)
                assert field.to_numpy().tolist() == expected
        assert two.total(count) == 2.0 * value * count
        assert three.total(count) == 3.0 * value * count
        assert three.wet(6.5) == SIZE - count + count * (3.0 * value > 6.5)


def test_each_launch_uses_its_own_array(pair) -> None:
    values = np.arange(2 * SIZE, dtype=np.float32)
    for k, scaled in enumerate(pair):
        scaled.load(values[k * SIZE :])
    assert pair[0].one.to_numpy().tolist() == values[:SIZE].tolist()
    assert pair[1].one.to_numpy().tolist() == values[SIZE:].tolist()
    with pytest.raises(ValueError, match="contiguous"):
        pair[0].load(values[::2])


@fast_only
def test_few_particles_make_loops_serial(monkeypatch) -> None:
    """The second launch compiles serial loops, which the fourth reuses."""
    built = []
    monkeypatch.setattr(launches, "_serial", False)  # as with several threads
    serialize = launches.serialize
    monkeypatch.setattr(launches, "serialize", lambda context: built.append(serialize(context)))
    traits = Traits()
    with use_traits(traits):
        scaled = Scaled(2.0)
    for particles, loops_made_serial in ((math.inf, 0), (10, 1), (MOST_SERIAL + 1, 1), (10, 1)):
        traits.particles = particles
        scaled.fill(SIZE, scaled.one, False, 1.5)
        assert scaled.one.to_numpy().tolist() == [3.0] * SIZE
        assert len(built) == loops_made_serial


@fast_only
def test_a_heavy_kernel_does_not_change_how_others_are_compiled() -> None:
    """Regression: Taichi's own kernels that were compiled later also had loops in blocks."""
    config = ti.lang.impl.get_runtime().prog.config()
    before, scaled = getattr(config, EQUAL_PARTS), Scaled(1.0)
    scaled.one.from_numpy(np.arange(SIZE, dtype=np.float32))
    scaled.double(SIZE)
    assert scaled.other.to_numpy().tolist() == (2.0 * np.arange(SIZE)).tolist()
    assert before and getattr(config, EQUAL_PARTS) == before


@fast_only
def test_on_cuda_loops_of_few_particles_have_few_blocks(monkeypatch) -> None:
    """The compiler's option is set for the kernels of small scenes only, and no loop is serial."""
    config = ti.lang.impl.get_runtime().prog.config()
    blocks, before, set_options = [], getattr(config, GRID), launches._compiler_options

    @contextlib.contextmanager
    def options(config, given):
        with set_options(config, given):
            blocks.append(getattr(config, GRID))
            yield config

    monkeypatch.setattr(launches, "_serial", False)  # as with several threads
    monkeypatch.setattr(launches, "on_cpu", lambda: False)
    monkeypatch.setattr(launches, "on_cuda", lambda: True)
    monkeypatch.setattr(launches, "_compiler_options", options)
    traits = Traits()
    with use_traits(traits):
        scaled = Scaled(2.0)
    for particles in (FEW + 1, 10):
        traits.particles = particles
        scaled.fill(SIZE, scaled.one, False, 1.5)
        assert scaled.one.to_numpy().tolist() == [3.0] * SIZE
    assert blocks == [BLOCKS, FEW_BLOCKS] and getattr(config, GRID) == before == BLOCKS


def test_vectors_reach_the_kernel_in_order(pair) -> None:
    for values, cell in (((1.5, -2.0, 4.0), (7, -8, 9)), ([0.25, 0.5, 8.0], (1, 2, 3))):
        for scaled in pair:
            scaled.one.fill(0.0)
            scaled.place(scaled.one, 1, values, cell)
            expected = [0.0, *(scaled.factor * v for v in values), *cell, 0.0]
            assert scaled.one.to_numpy().tolist() == expected


@fast_only
def test_vectors_of_another_length_are_refused(pair) -> None:
    pair[0].place(pair[0].one, 0, (1.0, 2.0, 3.0), (1, 2, 3))
    for wrong in ((1.0, 2.0), (1.0, 2.0, 3.0, 4.0)):
        with pytest.raises(ValueError):
            pair[0].place(pair[0].one, 0, wrong, (1, 2, 3))


@fast_only
def test_later_launches_skip_taichis_python(pair, monkeypatch) -> None:
    one = pair[0]
    one.load(np.arange(1.5, SIZE + 1.5, dtype=np.float32))
    first, ends = one.total(SIZE), one.ends(3)

    def refuse(*args):
        raise AssertionError("went through Taichi again")

    monkeypatch.setattr(Kernel, "__call__", refuse)
    monkeypatch.setattr(Kernel, "ensure_compiled", refuse)
    assert one.total(SIZE) == first
    assert list(one.ends(3)) == list(ends) == [1.5, 3.5]


@fast_only
def test_a_step_compiles_or_launches_one_new_kernel() -> None:
    """Regression: the window stood still while a function compiled several kernels in one frame."""
    one, compiled, done = Scaled(2.0), [], []

    def double_and_sum():
        one.fill(SIZE, one.one, False, 1.0)
        one.double(SIZE)
        done.append(one.total(SIZE))

    with watch_compiling(compiled.append):
        numbers = []
        while not run_in_steps(double_and_sum):
            numbers.append(len(compiled))
    assert numbers == [1, 1, 2, 2, 3, 3] and done == [2.0 * SIZE]
    assert one.total(SIZE) == done[0]


def test_wrong_arguments_are_refused(pair) -> None:
    pair[0].total(SIZE)
    with pytest.raises(TypeError):
        pair[0].total(2.5)
    for wrong in ((), (SIZE, SIZE)):
        with pytest.raises(ti.TaichiSyntaxError):
            pair[0].total(*wrong)


class Layouts:
    """Functions whose last lines are hard to find."""

    @staticmethod
    def ends_in_a_call(
        value,
    ):
        text = """
of less indentation"""
        # A comment.
        if value:
            return max(
                value,
                # A comment.
            )

        return [
            text
        ]  # fmt: skip

    inside = _in_class_body(2)

    def ends_in_dead_code(self):
        return lambda: self

        self = None

    def ends_in_a_comment(self):
        def inner():
            return self

        # A comment.


@pytest.mark.parametrize("name", [n for n in vars(Layouts) if n.startswith("ends")])
def test_source_of_a_function_is_that_of_inspect(name) -> None:
    function = inspect.unwrap(getattr(Layouts, name))
    (lines, first), (expected, line) = _source_lines(function), inspect.getsourcelines(function)

    def tree(source: list[str]) -> str:
        return ast.dump(ast.parse("if True:\n" + "".join(source)))

    assert first == line and tree(lines) == tree(expected)


def test_methods_differ_from_functions() -> None:
    assert Layouts.inside and not _in_class_body(2)


# Launches a kernel after removing the interfaces of Taichi that are named as arguments.
SCRIPT = """
import sys
import taichi as ti
from taichi._lib import core
for name in sys.argv[1:]:
    delattr(core.KernelLaunchContext, name)
from msph.device import start
from msph.launches import data_oriented, kernel
from msph.taichi_internals import PLAIN

@data_oriented
class Sum:
    def __init__(self):
        self.total = ti.field(ti.f32, shape=())

    @kernel
    def add(self, v: ti.math.vec3, target: ti.template()):
        target[None] += v.x + 10.0 * v.y + 100.0 * v.z

start("cpu", threads=1)
total = Sum()
for _ in range(2):
    total.add((1.0, 2.0, 3.0), total.total)
print(PLAIN, kernel is ti.kernel, total.total[None])
"""


@pytest.mark.parametrize(
    ("switch", "lost", "plain"),
    [("", [], False), ("0", [], False), ("1", [], True), ("", ["set_struct_arg_int"], True)],
)
def test_plain_taichi_is_used_by_switch_or_if_needed(tmp_path, switch, lost, plain) -> None:
    script = tmp_path / "sum.py"
    script.write_text(SCRIPT)
    result = python(script, *lost, env={**os.environ, SWITCH: switch})
    assert result.stdout.splitlines()[-1] == f"{plain} {plain} 642.0"
    lacks = "lacks KernelLaunchContext.set_struct_arg_int: launches are slower"
    assert (lacks in result.stderr) == bool(lost)
