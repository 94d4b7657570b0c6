"""Device tables filled from the host, such as the constants of a scene or its layers."""

from typing import Any

import numpy as np
import taichi as ti

from msph.host_memory import memory_of
from msph.launches import data_oriented, small_kernel

# Scalar types of the members of a table.
f32, i32 = ti.f32, ti.i32


@data_oriented
class DeviceTable:
    """Struct field of shape (), (rows,) or (rows, columns) with members of f32 or i32 (scalars,
    vectors, matrices), written from the host: on a CPU directly, on a GPU by one launch.

    Each member is an attribute, a Taichi field of that shape: kernels read `table.spacing[layer]`,
    or `table.size[None]` for shape (). `struct` is the whole struct field. No member may be named
    `shape`. Kernels need no recompilation when the values change.

    A kernel must read a whole vector (`size = table.size[None]`) before its components:
    `table.size[None][k]` makes Taichi replace per-thread sums by atomic additions.
    """

    def __init__(self, shape: tuple[int, ...], **members: Any):
        self.shape, self._rows = shape, int(np.prod(shape))
        self._columns = shape[1] if len(shape) == 2 else 1
        # Components and number type of each member.
        self.fields = {name: _width_and_type(kind) for name, kind in members.items()}
        field = self.struct = ti.types.struct(**members).field(shape=shape, layout=ti.Layout.SOA)
        self.__dict__.update({name: field.get_member_field(name) for name in members})
        self._memories: dict[str, Any] = {name: memory_of(getattr(self, name)) for name in members}
        self._used = 0  # rows of the last fill()
        self._numbers, self._integers = self._slots(np.float32), self._slots(np.int32)
        # Values by number type, (rows, columns), and a view of the columns of each member.
        self._values: dict[type, np.ndarray] = {}
        self._views: dict[str, np.ndarray] = {}
        for kind, slots in ((np.float32, self._numbers), (np.int32, self._integers)):
            values = np.zeros((*shape, sum(len(fields) for _, _, fields in slots)), kind)
            self._values[kind] = values.reshape(self._rows, -1)
            for name, first, fields in slots:
                self._views[name] = values[..., first : first + len(fields)]

    def __getattr__(self, name: str) -> Any:
        # For type checkers, which cannot know the members.
        raise AttributeError(f"the table has no member {name}")

    def _slots(self, kind: type) -> list[tuple[str, int, list[Any]]]:
        """Returns name, first column and scalar fields of each member of one number type."""
        slots: list[tuple[str, int, list[Any]]] = []
        column = 0
        for name in (name for name, (_, found) in self.fields.items() if found is kind):
            slots.append((name, column, _components(getattr(self, name))))
            column += len(slots[-1][2])
        return slots

    def fill(self, **values: Any) -> None:
        """Writes all rows. values: an array per member, of shape (rows used, components), or (rows,
        columns, components) for a table of two axes; members and rows not given become 0. Without
        values all rows become 0, also those that kernels have written."""
        for table in self._values.values():
            table[:] = 0
        used = 1
        for name, value in values.items():
            if name not in self._views:
                raise TypeError(f"the table has no {name}")
            view, given = self._views[name], np.asarray(value)
            given = given.reshape(*given.shape[: len(self.shape)], view.shape[-1])
            view[tuple([slice(n) for n in given.shape[:-1]])] = given
            used = max(used, given.shape[0] * self._rows // view.shape[0])
        # Rows beyond those that were used before are 0, unless kernels have written them.
        rows = max(used, self._used) if values else self._rows
        if all(self._memories.values()):
            for name, memory in self._memories.items():
                memory.write(self._views[name], rows // self._columns)
        else:
            self._store(*self._values.values(), rows)
        self._used = used

    @small_kernel
    def _store(
        self,
        numbers: ti.types.ndarray(dtype=ti.f32, ndim=2),
        integers: ti.types.ndarray(dtype=ti.i32, ndim=2),
        rows: ti.i32,
    ):
        for row in range(rows):
            for _, first, slots in ti.static(self._numbers):
                for k, slot in ti.static(enumerate(slots)):
                    self._put(slot, row, numbers[row, first + k])
            for _, first, slots in ti.static(self._integers):
                for k, slot in ti.static(enumerate(slots)):
                    self._put(slot, row, integers[row, first + k])

    @ti.func
    def _put(self, slot: ti.template(), row, value):
        """Writes a value to a row of a scalar field."""
        if ti.static(len(self.shape) == 0):
            slot[None] = value
        elif ti.static(len(self.shape) == 1):
            slot[row] = value
        else:
            slot[row // self._columns, row % self._columns] = value


def _width_and_type(kind: Any) -> tuple[int, type]:
    """Returns the number of components of a member type, and their NumPy type."""
    width = getattr(kind, "n", 1) * getattr(kind, "m", 1)
    number = getattr(kind, "dtype", kind)
    return width, np.int32 if number is ti.i32 else np.float32


def _components(field: Any) -> list[Any]:
    """Returns the scalar fields of a member, matrices row by row."""
    if not isinstance(field, ti.MatrixField):
        return [field]
    if field.m == 1:
        return [field.get_scalar_field(k) for k in range(field.n)]
    return [field.get_scalar_field(a, b) for a in range(field.n) for b in range(field.m)]
