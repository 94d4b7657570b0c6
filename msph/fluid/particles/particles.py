"""The particle pool and its registry of attributes.

An attribute is declared once. From the declaration follow its allocation, its place in the sort,
in checkpoints and exports, and the views that colour by it.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import taichi as ti

from msph.taichi_internals import data_oriented, kernel, on_cpu

# Sizes up to which one CPU thread is as fast as two, whose waking takes 25 to 50 us: particles of a
# loop over neighbours, particles of any other loop, cells of a scan.
FEW, FEW_LIGHT, FEW_CELLS = 1_300, 10_000, 50_000
# Factor by which the number of particles must pass FEW before a run changes from one thread to
# several, or back: each has kernels of its own, which take about a second to compile.
HYSTERESIS = 1.5


def one_thread_does(entries: int, few: float = FEW) -> bool:
    """Whether a loop over so many entries should stay on one CPU thread. `few`: the limit for two
    threads, which halve a loop's time; T threads save (T - 1)/T of it, so their limit is lower."""
    threads = ti.cfg.cpu_max_num_threads
    return on_cpu() and 2 * (threads - 1) * entries <= threads * few


@dataclass(frozen=True)
class Attribute:
    """One quantity that every particle has.

    width is 1 for a scalar and 3 for a vector. carried: it must survive sorting and belongs into
    checkpoints; what is not carried is recomputed before it is read. Halves of a split inherit a
    carried number, and a merge takes the mean of both, unless own: then whoever splits and merges
    sets it. view: the name of the picture that colours particles by it, None for no view.
    """

    name: str
    unit: str
    help: str
    width: int = 1
    integer: bool = False
    carried: bool = True
    own: bool = False
    view: str | None = None

    @property
    def bytes(self) -> int:
        """Device memory per particle [bytes], with the copy that sorting needs."""
        return 4 * self.width * (2 if self.carried else 1)

    def allocate(self, capacity: int):
        dtype = ti.i32 if self.integer else ti.f32
        if self.width == 1:
            return ti.field(dtype, shape=capacity)
        return ti.Vector.field(self.width, dtype, shape=capacity)


CORE = (
    Attribute("x", "m", "position in the box's frame, min corner the origin", width=3, own=True),
    Attribute("v", "m/s", "velocity", width=3, own=True, view="speed"),
    Attribute("layer", "-", "index of its layer", integer=True, own=True, view="layers"),
    Attribute("id", "-", "identity that sorting does not change", integer=True, own=True),
)


@data_oriented
class Particles:
    """A preallocated pool: one Taichi field of shape (capacity,) per attribute, by its name.

    count is the number of live particles; they are the first `count` of every field.
    """

    x: Any
    v: Any
    layer: Any
    id: Any

    def __init__(self, capacity: int, attributes: tuple[Attribute, ...] = ()):
        self.capacity = capacity
        self.count = 0
        self._alone: bool | None = None
        # Whether loops that meet no neighbours stay on one thread.
        self.light = one_thread_does(capacity, FEW_LIGHT)
        self.attributes = {a.name: a for a in CORE + attributes}
        self.fields = {a.name: a.allocate(capacity) for a in self.attributes.values()}
        self.__dict__.update(self.fields)
        carried = [a for a in self.attributes.values() if a.carried]
        self._pairs = [(self.fields[a.name], a.allocate(capacity)) for a in carried]
        # Names of vectors, of numbers and of integers: the columns of the tables by which fill()
        # and state() exchange all attributes with the host.
        every = self.attributes.values()
        self._names = (
            [a.name for a in every if a.width == 3],
            [a.name for a in every if a.width == 1 and not a.integer],
            [a.name for a in every if a.integer],
        )
        self._vectors, self._numbers, self._integers = (
            [self.fields[name] for name in names] for names in self._names
        )

    @staticmethod
    def bytes_per_particle(attributes: tuple[Attribute, ...]) -> int:
        return sum(a.bytes for a in CORE + attributes)

    def fill(self, **values: np.ndarray) -> None:
        """Replaces all particles by the given attributes, arrays of shape (n,) or (n, 3).

        Carried attributes that are not given become zero, ids count up from zero.
        """
        n = len(values["x"])
        if n > self.capacity:
            raise ValueError(f"{n} particles do not fit in a pool of {self.capacity}")
        values.setdefault("id", np.arange(n, dtype=np.int32))
        vectors, numbers, integers = self._tables(n)
        for table, names in zip((vectors, numbers, integers), self._names, strict=True):
            for column, name in enumerate(names):
                table[:, column] = values.get(name, 0)
        self._write(vectors, numbers, integers, n)
        self.count, self._alone = n, None

    def _tables(self, n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Room for the vectors, the numbers and the integers of n particles."""
        vectors, numbers, integers = map(len, self._names)
        return (
            np.zeros((n, vectors, 3), np.float32),
            np.zeros((n, numbers), np.float32),
            np.zeros((n, integers), np.int32),
        )

    @kernel
    def _write(
        self,
        vectors: ti.types.ndarray(dtype=ti.f32, ndim=3),
        numbers: ti.types.ndarray(dtype=ti.f32, ndim=2),
        integers: ti.types.ndarray(dtype=ti.i32, ndim=2),
        n: ti.i32,
    ):
        """One kernel for all attributes: one for each would take 10 ms to compile."""
        ti.loop_config(serialize=self.light)
        for i in range(n):
            for column, field in ti.static(enumerate(self._vectors)):
                for k in ti.static(range(3)):
                    field[i][k] = vectors[i, column, k]
            for column, field in ti.static(enumerate(self._numbers)):
                field[i] = numbers[i, column]
            for column, field in ti.static(enumerate(self._integers)):
                field[i] = integers[i, column]
        ti.loop_config(serialize=self.light)
        for i in range(n, self.capacity):
            for field in ti.static(self._vectors):
                field[i] = 0
            for field in ti.static(self._numbers):
                field[i] = 0
            for field in ti.static(self._integers):
                field[i] = 0

    @kernel
    def _read(
        self,
        vectors: ti.types.ndarray(dtype=ti.f32, ndim=3),
        numbers: ti.types.ndarray(dtype=ti.f32, ndim=2),
        integers: ti.types.ndarray(dtype=ti.i32, ndim=2),
        n: ti.i32,
    ):
        """What _write() writes, the other way."""
        ti.loop_config(serialize=self.light)
        for i in range(n):
            for column, field in ti.static(enumerate(self._vectors)):
                for k in ti.static(range(3)):
                    vectors[i, column, k] = field[i][k]
            for column, field in ti.static(enumerate(self._numbers)):
                numbers[i, column] = field[i]
            for column, field in ti.static(enumerate(self._integers)):
                integers[i, column] = field[i]

    @property
    def alone(self) -> bool:
        """Whether kernels should keep loops over neighbours on one thread (a template)."""
        leeway = {None: 1.0, True: HYSTERESIS, False: 1.0 / HYSTERESIS}[self._alone]
        self._alone = one_thread_does(self.count, leeway * FEW)
        return self._alone

    def inherited(self) -> tuple[ti.Field, ...]:
        """Fields that halves of a split take over, and merges average."""
        return tuple(
            self.fields[a.name] for a in self.attributes.values() if a.carried and not a.own
        )

    def numpy(self, name: str) -> np.ndarray:
        """One attribute of the live particles, (count,) or (count, width)."""
        return self.fields[name].to_numpy()[: self.count]

    def check(self, values: dict[str, np.ndarray]) -> None:
        """Raises ValueError unless the arrays are carried attributes of 1 to capacity particles."""
        n = len(values["x"]) if values["x"].ndim == 2 else 0
        if not 1 <= n <= self.capacity:
            raise ValueError(f"it has {n} particles, the pool holds 1 to {self.capacity}")
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
        """Every carried attribute of the live particles: what a checkpoint holds."""
        tables = self._tables(self.count)
        self._read(*tables, self.count)
        return {
            name: table[:, column].copy()
            for table, names in zip(tables, self._names, strict=True)
            for column, name in enumerate(names)
            if self.attributes[name].carried
        }

    @kernel
    def compact(self, target: ti.template(), alive: ti.template(), n: ti.i32):
        """Moves those of the first n with alive[i] = 1 to target[i]. Both i32 (n,)."""
        ti.loop_config(serialize=self.light)
        for i in range(n):
            if alive[i] == 1:
                for pair in ti.static(self._pairs):
                    pair[1][target[i]] = pair[0][i]
        ti.loop_config(serialize=self.light)
        for i in range(n):
            for pair in ti.static(self._pairs):
                pair[0][i] = pair[1][i]

    @ti.func
    def reorder(self, target: ti.template(), n):
        """Moves particle i to place target[i], for every carried attribute. target: i32 (n,)."""
        ti.loop_config(serialize=self.light)
        for i in range(n):
            t = target[i]
            for pair in ti.static(self._pairs):
                pair[1][t] = pair[0][i]
        ti.loop_config(serialize=self.light)
        for i in range(n):
            for pair in ti.static(self._pairs):
                pair[0][i] = pair[1][i]
