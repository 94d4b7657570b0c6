"""Constant tables on the device."""

import numpy as np
import taichi as ti

from msph.taichi_internals import data_oriented, field_trees, kernel

# Trees of fields that a process has room for, and how many of them a simulation, its surface and
# its picture may need: beyond, Taichi ends in a segmentation fault.
TREES, NEEDED = 512, 24


def constant_fields(*arrays: np.ndarray) -> list:
    """A field of i32 or f32 for each array, of its shape and values.

    All are declared before the first is filled: what is declared in one go shares one tree of
    Taichi's memory, and a process has room for TREES. Raises RuntimeError where hardly any is left.
    """
    taken = field_trees()
    if taken > TREES - NEEDED:
        raise RuntimeError(
            f"{taken} of {TREES} trees of Taichi's fields are taken: "
            "no room for another simulation in this process"
        )
    kinds = [np.int32 if np.issubdtype(a.dtype, np.integer) else np.float32 for a in arrays]
    fields = [
        ti.field(ti.i32 if kind is np.int32 else ti.f32, shape=a.shape)
        for a, kind in zip(arrays, kinds, strict=True)
    ]
    for wanted in set(kinds):
        chosen = [k for k, kind in enumerate(kinds) if kind is wanted]
        values = np.concatenate([arrays[k].ravel() for k in chosen]).astype(wanted)
        write = _Tables([fields[k] for k in chosen])
        (write.integers if wanted is np.int32 else write.numbers)(values)
    return fields


@data_oriented
class _Tables:
    """Fields of one type, filled by one kernel: a kernel for each would take 10 ms to compile."""

    def __init__(self, fields: list):
        self.fields = fields
        self.sizes = [int(np.prod(f.shape)) for f in fields]
        self.first = np.cumsum([0, *self.sizes[:-1]]).tolist()
        # Values along the last axes, by which a place in a field becomes an index.
        self.strides = [
            [int(np.prod(f.shape[axis + 1 :])) for axis in range(len(f.shape))] for f in fields
        ]

    @kernel
    def numbers(self, values: ti.types.ndarray(dtype=ti.f32, ndim=1)):
        self._write(values)

    @kernel
    def integers(self, values: ti.types.ndarray(dtype=ti.i32, ndim=1)):
        self._write(values)

    @ti.func
    def _write(self, values: ti.template()):
        # One loop over all values: a loop for each field would multiply the time to compile.
        ti.loop_config(serialize=True)
        for place in range(values.shape[0]):
            for k in ti.static(range(len(self.fields))):
                rest = place - self.first[k]
                if 0 <= rest < self.sizes[k]:
                    index = ti.Vector(self.strides[k])
                    for axis in ti.static(range(index.n)):
                        stride = self.strides[k][axis]
                        index[axis], rest = rest // stride, rest % stride
                    self.fields[k][index] = values[place]
