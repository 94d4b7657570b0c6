"""Copies between fields and arrays without kernels, on a CPU.

Taichi compiles a kernel for each field that is filled, read or written as a whole, and another one
for each value that fills it: at a start from the cache of kernels 15 to 60 ms of CPU time each.
Here arrays give access to the memory of fields, and values for fields that are not allocated yet
are written once they are. Fields of other layouts than those of ti.field() and ti.Vector.field()
are left to Taichi, as are all fields on a GPU.
"""

import ctypes
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import taichi as ti

from msph.taichi_internals import PLAIN, on_cpu

if not PLAIN:
    import taichi._kernels as taichi_kernels

    from msph.taichi_internals import core, impl

# Address of the memory of each tree of fields, by the id of its root.
_roots: dict[int, int] = {}
# Writes to fields that are not allocated, in order.
_later: list[Callable[[], None]] = []
# NumPy's type of each type of numbers in fields.
TYPES = {ti.f32: "f4", ti.f64: "f8", ti.i32: "i4", ti.u32: "u4", ti.i64: "i8", ti.u64: "u8"}


@ti.kernel
def _address(field: ti.template(), first: ti.template()) -> ti.u64:
    return ti.get_addr(field, first)


class Memory:
    """Memory of a scalar, vector or matrix field. number: of components; known: False if the layout
    is another one than cells in rows, each with all components."""

    def __init__(self, field: Any):
        self.field, self.number = field, len(field.vars)
        self.places = [var.ptr.snode() for var in field.vars]
        self.cell = self.places[0].parent
        self.root = self.cell.parent
        self.known = (
            field.dtype in TYPES
            and self.cell.type == core.SNodeType.dense
            and self.root.type == core.SNodeType.root
            and all(p.parent.id == self.cell.id and not p.offset for p in self.places)
        )
        self.view: Any = None

    def array(self) -> np.ndarray:
        """Returns the memory of an allocated field, (*shape, components)."""
        if self.view is None:
            shape, kind = self.field.shape, np.dtype(TYPES[self.field.dtype])
            # Offsets [bytes], known once the field is allocated.
            first, *others = (place.offset_bytes_in_parent_cell for place in self.places)
            assert others == [first + kind.itemsize * k for k in range(1, self.number)]
            first += self.cell.offset_bytes_in_parent_cell
            if self.root.id not in _roots:
                member = ti.ScalarField(self.field.vars[0])
                _roots[self.root.id] = _address(member, (0,) * len(shape)) - first
            step = self.cell.cell_size_bytes
            strides = *(step * math.prod(shape[k + 1 :]) for k in range(len(shape))), kind.itemsize
            address = _roots[self.root.id] + first
            memory = (ctypes.c_char * (step * math.prod(shape))).from_address(address)
            self.view = np.ndarray((*shape, self.number), kind, memory, strides=strides)
        return self.view

    def allocated(self) -> np.ndarray:
        """Returns array(), and allocates the field first."""
        impl.get_runtime().materialize()
        return self.array()

    def write(self, values: Any, rows: int | None = None) -> None:
        """Writes values of the field's shape and components, or one value for all; of the first
        `rows` along the first axis, None for all."""
        if self.view is None and self.root.id == impl._root_fb.root.ptr.id:
            kept = np.array(values)
            _later.append(lambda: self.write(kept))
            return
        view = self.array() if self.view is None else self.view
        if rows is None or view.ndim == 1:
            view[...] = values
        else:
            view[:rows] = values[:rows]


def memory_of(field: Any) -> Memory | None:
    """Returns the memory of a field, None where only kernels reach it."""
    if "host_memory" not in vars(field):
        memory = None if PLAIN or not on_cpu() else Memory(field)
        field.host_memory = memory if memory and memory.known else None
    return field.host_memory


def _or_kernel(kernel: Any, copy: Callable[..., None], place: int) -> Callable[..., None]:
    """Returns a function like one of Taichi's kernels that calls `copy` with the memory of the
    field, its argument number `place`, if known."""

    def call(*arguments: Any) -> None:
        memory = memory_of(arguments[place])
        if memory is None:
            kernel(*arguments)
        else:
            copy(memory, *arguments)

    return call


def _fill(memory: Memory, field: Any, value: Any) -> None:
    memory.write(np.ravel(value))


def _write(memory: Memory, array: np.ndarray, field: Any, as_vector: bool = False) -> None:
    memory.write(np.reshape(array, (*field.shape, memory.number)))


def _read(memory: Memory, field: Any, array: np.ndarray, as_vector: bool = False) -> None:
    array.reshape(*field.shape, memory.number)[...] = memory.allocated()


# Taichi's kernels that copy whole fields, and the number of their argument that is the field.
COPIES = {
    "fill_field": (_fill, 0),
    "field_fill_python_scope": (_fill, 0),
    "ext_arr_to_tensor": (_write, 1),
    "ext_arr_to_matrix": (_write, 1),
    "tensor_to_ext_arr": (_read, 0),
    "matrix_to_ext_arr": (_read, 0),
}


if not PLAIN:
    _materialize = impl.PyTaichi.materialize

    def _materialize_and_write(self: Any) -> None:
        """Allocates all fields, and writes their values."""
        _materialize(self)
        waiting = _later[:]
        _later.clear()
        for write in waiting:
            write()

    impl.PyTaichi.materialize = _materialize_and_write
    for name, (copy, place) in COPIES.items():
        replaced = _or_kernel(getattr(taichi_kernels, name), copy, place)
        setattr(taichi_kernels, name, replaced)
