"""Tests of copies between fields and arrays, with the memory of fields on a CPU."""

import numpy as np
import pytest
import taichi as ti

from msph import host_memory
from msph.device_table import DeviceTable, f32, i32
from msph.launches import data_oriented, kernel
from msph.taichi_internals import PLAIN, on_cpu

SHAPES = [(), (5,), (3, 4), (2, 3, 4)]
# Components of a field by its kind, and its constructor.
KINDS = {
    "number": ((), lambda s: ti.field(ti.f32, shape=s)),
    "integer": ((), lambda s: ti.field(ti.i32, shape=s)),
    "vector": ((3,), lambda s: ti.Vector.field(3, ti.f32, shape=s)),
    "matrix": ((2, 3), lambda s: ti.Matrix.field(2, 3, ti.f32, shape=s)),
    "planes": ((3,), lambda s: ti.Vector.field(3, ti.f32, shape=s, layout=ti.Layout.SOA)),
    "shifted": ((), lambda s: ti.field(ti.f32, shape=s, offset=(7,) * len(s) or None)),
}


@data_oriented
class Sum:
    """Sum of a field's elements, by a kernel."""

    def __init__(self, field):
        self.field = field

    @kernel
    def read(self) -> ti.f32:
        total = 0.0
        for i in ti.grouped(self.field):
            total += ti.cast(self.field[i], ti.f32).sum()
        return total

    @kernel
    def read_numbers(self) -> ti.f32:
        total = 0.0
        for i in ti.grouped(self.field):
            total += ti.cast(self.field[i], ti.f32)
        return total


@pytest.mark.parametrize("kind", KINDS)
def test_arrays_are_copied_to_fields_before_and_after_their_allocation(kind):
    components, make = KINDS[kind]
    fields = [make(shape) for shape in SHAPES]
    for again in range(2):
        for shape, field in zip(SHAPES, fields, strict=True):
            values = np.random.default_rng(again).integers(1, 9, (*shape, *components))
            field.fill(5)
            field.from_numpy(values.astype("i4" if kind == "integer" else "f4"))
            of = Sum(field)
            assert (of.read if components else of.read_numbers)() == values.sum()
            assert np.array_equal(field.to_numpy(), values)
            field.fill(2)
            assert (field.to_numpy() == 2).all()
            if components:
                assert field.to_numpy(keep_dims=True).shape[: len(shape)] == shape
    direct = on_cpu() and not PLAIN and kind not in ("planes", "shifted")
    assert bool(host_memory.memory_of(fields[1])) == direct


def test_the_last_write_before_the_allocation_counts():
    table = DeviceTable((4,), size=f32, axis=ti.math.vec3, number=i32)
    field = ti.field(ti.f32, shape=3)
    table.fill(size=[1.0, 2.0], number=[3, 4])
    table.fill(size=[5.0], axis=[(1.0, 2.0, 3.0)])
    given = np.ones(3, np.float32)
    field.from_numpy(given)
    given[:] = 7.0
    field[1] = 6.0
    assert field.to_numpy().tolist() == [1.0, 6.0, 1.0]
    assert table.size.to_numpy().tolist() == [5.0, 0.0, 0.0, 0.0]
    assert table.axis[0].to_list() == [1.0, 2.0, 3.0] and table.number[1] == 0
