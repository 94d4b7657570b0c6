"""Tables on the device that the host refills: the numbers of a scene, its layers, its bodies."""

from typing import Any

import numpy as np
import taichi as ti

from msph.taichi_internals import data_oriented, kernel

# Types of a member of a table, beside vectors and matrices of f32 and i32.
f32, i32 = ti.f32, ti.i32


@data_oriented
class DeviceTable:
    """A table of shape (), (rows,) or (rows, columns) with members of f32 or i32, which one launch
    writes from the host.

    Each member is an attribute, a Taichi field of that shape: kernels read `table.spacing[layer]`,
    or `table.size[None]` where the shape is (). Kernels that read a table need not be compiled
    again when its numbers change.
    """

    def __init__(self, shape: tuple[int, ...], /, **members: Any):
        self._shape, self._rows = shape, int(np.prod(shape))
        self._columns = shape[1] if len(shape) == 2 else 1
        # Components and number type of each member.
        self.fields = {name: _width_and_type(kind) for name, kind in members.items()}
        found = {name: _unplaced(kind) for name, kind in members.items()}
        self.__dict__.update(found)
        # A row's members lie side by side.
        place = ti.root.dense([ti.i, ti.ij][len(shape) - 1], shape) if shape else ti.root
        for field in found.values():
            place.place(field)
        slots = [(self.fields[n][1], slot) for n, f in found.items() for slot in _components(f)]
        self._numbers = [slot for kind, slot in slots if kind is np.float32]
        self._integers = [slot for kind, slot in slots if kind is np.int32]

    def fill(self, **values: Any) -> None:
        """Writes all rows. values: of each member an array of shape (rows used, components), or
        (rows, columns, components) of a table of two axes; what is not given becomes 0."""
        tables = {np.float32: [], np.int32: []}
        for name, (width, kind) in self.fields.items():
            table = np.zeros((*self._shape, width), kind)
            if name in values:
                given = np.asarray(values.pop(name), kind)
                given = given.reshape(*given.shape[: len(self._shape)], width)
                table[tuple(slice(n) for n in given.shape[:-1])] = given
            tables[kind].append(table.reshape(self._rows, width))
        if values:
            raise TypeError(f"the table has no {', '.join(values)}")
        empty = np.zeros((self._rows, 0))
        self._store(
            np.concatenate([empty, *tables[np.float32]], axis=1).astype(np.float32),
            np.concatenate([empty, *tables[np.int32]], axis=1).astype(np.int32),
        )

    @kernel
    def _store(
        self,
        numbers: ti.types.ndarray(dtype=ti.f32, ndim=2),
        integers: ti.types.ndarray(dtype=ti.i32, ndim=2),
    ):
        for row in range(self._rows):
            for column, slot in ti.static(enumerate(self._numbers)):
                if ti.static(len(self._shape) == 0):
                    slot[None] = numbers[row, column]
                elif ti.static(len(self._shape) == 1):
                    slot[row] = numbers[row, column]
                else:
                    slot[row // self._columns, row % self._columns] = numbers[row, column]
            for column, slot in ti.static(enumerate(self._integers)):
                if ti.static(len(self._shape) == 0):
                    slot[None] = integers[row, column]
                elif ti.static(len(self._shape) == 1):
                    slot[row] = integers[row, column]
                else:
                    slot[row // self._columns, row % self._columns] = integers[row, column]


def _width_and_type(kind: Any) -> tuple[int, type]:
    """Components of a member, and their number type."""
    width = getattr(kind, "n", 1) * getattr(kind, "m", 1)
    number = getattr(kind, "dtype", kind)
    return width, np.int32 if number is ti.i32 else np.float32


def _unplaced(kind: Any) -> Any:
    """A field of a member's type, which has no place yet."""
    if not hasattr(kind, "n"):
        return ti.field(kind)
    if getattr(kind, "m", 1) == 1:
        return ti.Vector.field(kind.n, kind.dtype)
    return ti.Matrix.field(kind.n, kind.m, kind.dtype)


def _components(field: Any) -> list[Any]:
    """Scalar fields of a member, rows of a matrix one after the other."""
    if not isinstance(field, ti.MatrixField):
        return [field]
    if field.m == 1:
        return [field.get_scalar_field(k) for k in range(field.n)]
    return [field.get_scalar_field(a, b) for a in range(field.n) for b in range(field.m)]
