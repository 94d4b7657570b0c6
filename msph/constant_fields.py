"""Constant tables on the device."""

import numpy as np
import taichi as ti

from msph.taichi_internals import field_trees

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
    for field, array, kind in zip(fields, arrays, kinds, strict=True):
        field.from_numpy(np.ascontiguousarray(array, kind))
    return fields
