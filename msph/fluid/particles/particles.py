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
        every = {a.name: a for a in CORE + attributes}
        self.attributes = every
        self.fields = {a.name: a.allocate(room) for a in every.values()}
        self.__dict__.update(self.fields)
        self._every = list(self.fields.values())
        carried = [a for a in every.values() if a.carried]
        self._pairs = [(self.fields[a.name], a.allocate(room)) for a in carried]
        self.inherited = tuple(self.fields[a.name] for a in carried if a.inherited)
        # Names of the vectors, scalars and integers: columns of the tables by which fill()
        # writes all attributes on a GPU.
        self._names = (
            [a.name for a in every.values() if a.width == 3],
            [a.name for a in every.values() if a.width == 1 and not a.integer],
            [a.name for a in every.values() if a.integer],
        )
        self._vectors, self._numbers, self._integers = (
            [self.fields[name] for name in names] for names in self._names
        )

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
        memories = {name: memory_of(field) for name, field in self.fields.items()}
        if all(memories.values()):
            for name, memory in memories.items():
                rows = memory.allocated()
                rows[:n] = values[name].reshape(n, memory.number) if name in values else 0
                rows[n : self.touched] = 0
        else:
            self._fill_by_kernel(n, values)
        self.count, self.touched = n, self.capacity

    def _fill_by_kernel(self, n: int, values: dict[str, np.ndarray]) -> None:
        vectors, numbers, integers = map(len, self._names)
        tables = (
            np.zeros((n, vectors, 3), np.float32),
            np.zeros((n, numbers), np.float32),
            np.zeros((n, integers), np.int32),
        )
        for table, names in zip(tables, self._names, strict=True):
            for column, name in enumerate(names):
                table[:, column] = values.get(name, 0)
        self._write(*tables, n, self.touched)

    def extend(self, x: np.ndarray, v: np.ndarray, layer: int, opening: int = 0) -> None:
        """Adds particles of a layer at x [m] with velocities v [m/s], (n, 3), in the zone of an
        opening, counted from 1, if any; their other attributes are zero, except new ids."""
        first = int(self.numpy("id").max(initial=-1)) + 1
        vectors = [np.ascontiguousarray(a, np.float32) for a in (x, v)]
        self._extend(*vectors, layer, first, opening, self.count)
        self.count += len(x)

    @kernel
    def _extend(
        self,
        x: ti.types.ndarray(dtype=ti.f32, ndim=2),
        v: ti.types.ndarray(dtype=ti.f32, ndim=2),
        layer: ti.i32,
        first: ti.i32,
        opening: ti.i32,
        n: ti.i32,
    ):
        for k in range(x.shape[0]):
            i = n + k
            for field in ti.static(self._every):
                field[i] = 0
            self.layer[i], self.id[i], self.prescribed[i] = layer, first + k, opening
            for axis in ti.static(range(3)):
                self.x[i][axis], self.v[i][axis] = x[k, axis], v[k, axis]

    @kernel
    def _write(
        self,
        vectors: ti.types.ndarray(dtype=ti.f32, ndim=3),
        numbers: ti.types.ndarray(dtype=ti.f32, ndim=2),
        integers: ti.types.ndarray(dtype=ti.i32, ndim=2),
        n: ti.i32,
        touched: ti.i32,
    ):
        """Writes all attributes (a kernel for each takes 10 ms to compile); sets particles n to
        `touched` to zero."""
        for i in range(n):
            for column, field in ti.static(enumerate(self._vectors)):
                for k in ti.static(range(3)):
                    field[i][k] = vectors[i, column, k]
            for column, field in ti.static(enumerate(self._numbers)):
                field[i] = numbers[i, column]
            for column, field in ti.static(enumerate(self._integers)):
                field[i] = integers[i, column]
        for i in range(n, touched):
            for field in ti.static(self._every):
                field[i] = 0

    def numpy(self, name: str) -> np.ndarray:
        """Returns one attribute of the live particles, (count,) or (count, 3)."""
        vectors, numbers, integers = self._names
        if memory := memory_of(self.fields[name]):
            found = memory.allocated()[: self.count].copy()
            return found if memory.number > 1 else found[:, 0]
        if name in vectors:
            found = np.empty((self.count, 3), np.float32)
            self._read_vector(vectors.index(name), found, self.count)
        elif name in numbers:
            found = np.empty(self.count, np.float32)
            self._read_number(numbers.index(name), found, self.count)
        else:
            found = np.empty(self.count, np.int32)
            self._read_integer(integers.index(name), found, self.count)
        return found

    @kernel
    def _read_vector(self, which: ti.i32, found: ti.types.ndarray(dtype=ti.f32, ndim=2), n: ti.i32):
        for i in range(n):
            for column, field in ti.static(enumerate(self._vectors)):
                if which == column:
                    for k in ti.static(range(3)):
                        found[i, k] = field[i][k]

    @kernel
    def _read_number(self, which: ti.i32, found: ti.types.ndarray(dtype=ti.f32, ndim=1), n: ti.i32):
        for i in range(n):
            for column, field in ti.static(enumerate(self._numbers)):
                if which == column:
                    found[i] = field[i]

    @kernel
    def _read_integer(
        self, which: ti.i32, found: ti.types.ndarray(dtype=ti.i32, ndim=1), n: ti.i32
    ):
        for i in range(n):
            for column, field in ti.static(enumerate(self._integers)):
                if which == column:
                    found[i] = field[i]

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
