"""Particle storage and the declaration of particle attributes.

Allocation, sorting, checkpoints, exports and views follow from an attribute's declaration.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import taichi as ti

from msph.host_memory import memory_of
from msph.launches import data_oriented, kernel


@dataclass(frozen=True)
class Attribute:
    """One quantity of every particle.

    width: 1 for a scalar, 3 for a vector. carried: survives sorting and is part of checkpoints;
    other attributes are recomputed before use. inherited: the halves of a split copy a carried
    attribute and a merge averages it; otherwise splits and merges set it explicitly. view: name of
    the view that colours particles by it, or None.
    """

    name: str
    unit: str
    help: str
    width: int = 1
    integer: bool = False
    carried: bool = True
    inherited: bool = True
    view: str | None = None

    @property
    def words(self) -> int:
        """f32 or i32 numbers per particle, including the copy that sorting needs."""
        return self.width * (2 if self.carried else 1)

    @property
    def kind(self) -> type:
        """Type of its numbers."""
        return np.int32 if self.integer else np.float32

    def allocate(self, capacity: int):
        dtype = ti.i32 if self.integer else ti.f32
        if self.width == 1:
            return ti.field(dtype, shape=capacity)
        return ti.Vector.field(self.width, dtype, shape=capacity)


CORE = (
    Attribute("x", "m", "position from the box's lowest corner", width=3, inherited=False),
    Attribute("v", "m/s", "velocity", width=3, inherited=False, view="speed"),
    Attribute("layer", "-", "layer index", integer=True, inherited=False, view="layers"),
    Attribute("id", "-", "identifier, unchanged by sorting", integer=True, inherited=False),
    Attribute("alive", "-", "0 if to be removed", integer=True, carried=False),
)


@data_oriented
class Particles:
    """Preallocated particles: one Taichi field of shape (room,) per attribute, by its name.

    count is the number of live particles, the first `count` of every field. capacity: largest
    number in the scene. attributes: those of the scene's method, by name; fields exist for the
    attributes of all methods, so that the same kernels move them.
    """

    x: Any
    v: Any
    layer: Any
    id: Any
    alive: Any
    prescribed: Any
    viewed: Any

    def __init__(self, room: int, attributes: tuple[Attribute, ...]):
        self.capacity = room
        self.count = self.touched = 0
        every = self._every = {a.name: a for a in CORE + attributes}
        self.attributes = every
        self.fields = {a.name: a.allocate(room) for a in every.values()}
        self.__dict__.update(self.fields)
        carried = [a for a in every.values() if a.carried]
        self._pairs = [(self.fields[a.name], a.allocate(room)) for a in carried]
        self.inherited = tuple(self.fields[a.name] for a in carried if a.inherited)
        # Scalar fields of all attributes: columns of the tables by which kernels copy attributes,
        # as integers of the same bits; and the first column of each attribute.
        self._columns: list[Any] = []
        self._first: dict[str, int] = {}
        for a in every.values():
            field, self._first[a.name] = self.fields[a.name], len(self._columns)
            parts = [field] if a.width == 1 else [field.get_scalar_field(k) for k in range(a.width)]
            self._columns += parts

    def load(self, attributes: tuple[Attribute, ...], capacity: int) -> None:
        """Sets the attributes and the largest number of particles of a scene."""
        self.attributes = {a.name: a for a in CORE + attributes}
        self.capacity = capacity

    def fill(self, **values: np.ndarray) -> None:
        """Replaces all particles by the given attributes, arrays of shape (n,) or (n, 3).

        All other attributes become zero, except ids, which count up from zero.
        """
        n = len(values["x"])
        if n > self.capacity:
            raise ValueError(f"{n} particles exceed the capacity of {self.capacity}")
        values.setdefault("id", np.arange(n, dtype=np.int32))
        self._set(0, n, values)
        self.count, self.touched = n, self.capacity

    def extend(self, x: np.ndarray, v: np.ndarray, layer: int, opening: int = 0) -> None:
        """Adds particles of a layer at x [m] with velocities v [m/s], (n, 3), in the zone of an
        opening, counted from 1, if any; their other attributes are zero, except new ids."""
        k, first = len(x), int(self.numpy("id").max(initial=-1)) + 1
        names = {"id": np.arange(first, first + k), "layer": np.full(k, layer)}
        names["prescribed"] = np.full(k, opening)
        self._set(self.count, self.count + k, {"x": x, "v": v, **names})
        self.count += k

    def _set(self, begin: int, end: int, values: dict[str, np.ndarray]) -> None:
        """Sets all attributes of the particles from `begin` to `end`: those without values, and
        those of later particles, to 0."""
        memories = {name: memory_of(field) for name, field in self.fields.items()}
        if all(memories.values()):
            for name, memory in memories.items():
                rows = memory.allocated()
                rows[begin:end] = values[name].reshape(-1, memory.number) if name in values else 0
                rows[end : self.touched] = 0
        else:
            table = np.zeros((end - begin, len(self._columns)), np.int32)
            for name, value in values.items():
                attribute, first = self._every[name], self._first[name]
                columns = np.ascontiguousarray(value, attribute.kind).reshape(-1, attribute.width)
                table[:, first : first + attribute.width] = columns.view(np.int32)
            self._write(table, begin, end, self.touched)

    @kernel
    def _write(
        self,
        table: ti.types.ndarray(dtype=ti.i32, ndim=2),
        begin: ti.i32,
        end: ti.i32,
        touched: ti.i32,
    ):
        """Writes all attributes (a kernel for each takes 10 ms to compile); sets particles `end` to
        `touched` to zero."""
        for i in range(begin, end):
            for number, column in ti.static(enumerate(self._columns)):
                column[i] = ti.bit_cast(table[i - begin, number], column.dtype)
        for i in range(end, touched):
            for column in ti.static(self._columns):
                column[i] = 0

    def numpy(self, name: str) -> np.ndarray:
        """Returns one attribute of the live particles, (count,) or (count, 3)."""
        attribute = self._every[name]
        if memory := memory_of(self.fields[name]):
            found = memory.allocated()[: self.count].copy()
        else:
            table = np.empty((self.count, attribute.width), np.int32)
            self._read(table, self._first[name], self.count)
            found = table.view(attribute.kind)
        return found if attribute.width > 1 else found[:, 0]

    @kernel
    def _read(self, table: ti.types.ndarray(dtype=ti.i32, ndim=2), first: ti.i32, n: ti.i32):
        """Reads the columns from `first` on."""
        for i in range(n):
            for number, column in ti.static(enumerate(self._columns)):
                if number >= first and number < first + table.shape[1]:
                    table[i, number - first] = ti.bit_cast(column[i], ti.i32)

    def describe(self, k: int) -> str:
        """Returns a text with id, layer, position and velocity of particle k."""
        x, v = (", ".join(f"{n:.4g}" for n in self.numpy(name)[k]) for name in ("x", "v"))
        number, layer = (self.numpy(name)[k] for name in ("id", "layer"))
        return f"particle {number} of layer {layer} at ({x}) m with ({v}) m/s"

    def check(self, values: dict[str, np.ndarray]) -> None:
        """Raises ValueError unless the arrays are carried attributes of 1 to capacity particles."""
        n = len(values["x"]) if values["x"].ndim == 2 else 0
        if not 1 <= n <= self.capacity:
            raise ValueError(f"{n} particles: the pool holds 1 to {self.capacity}")
        for name, array in values.items():
            attribute = self.attributes.get(name)
            if attribute is None:
                raise ValueError(f"unknown attribute {name}")
            shape = (n,) if attribute.width == 1 else (n, attribute.width)
            kind = np.integer if attribute.integer else np.floating
            if array.shape != shape or not np.issubdtype(array.dtype, kind):
                raise ValueError(f"{name} is {array.dtype} of shape {array.shape}, not {shape}")
            if not np.all(np.isfinite(array)):
                raise ValueError(f"{name} is not finite")

    def state(self) -> dict[str, np.ndarray]:
        """Returns every carried attribute of the live particles, for checkpoints."""
        return {name: self.numpy(name) for name, a in self.attributes.items() if a.carried}

    @kernel
    def compact(self, target: ti.template(), alive: ti.template(), n: ti.i32):
        """Moves particles i < n with alive[i] = 1 to target[i]; both i32 (n,)."""
        for i in range(n):
            if alive[i] == 1:
                for pair in ti.static(self._pairs):
                    pair[1][target[i]] = pair[0][i]
        ti.loop_config(serialize=self.traits.light)
        for i in range(n):
            for pair in ti.static(self._pairs):
                pair[0][i] = pair[1][i]

    @ti.func
    def reorder(self, place: ti.template(), cell: ti.template(), start: ti.template(), n):
        """Moves every carried attribute of particle i to start[cell[i]] + place[i]. start: first
        particle of each cell; place: index within the cell; all i32."""
        ti.loop_config(serialize=self.traits.light)
        for i in range(n):
            t = start[cell[i]] + place[i]
            for pair in ti.static(self._pairs):
                pair[1][t] = pair[0][i]
        ti.loop_config(serialize=self.traits.light)
        for i in range(n):
            for pair in ti.static(self._pairs):
                pair[0][i] = pair[1][i]
