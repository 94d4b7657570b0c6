"""Stubs: kernels of earlier processes, found without tracing their code.

Taichi keeps compiled kernels on disk by a key of the syntax tree that its Python front end builds
from their source. The front end therefore runs at every start, 20 to 190 ms per kernel, before a
kernel is found. Here a process that traces a kernel records what the front end reads: files of
source, global names, attributes of objects, places of fields in memory. It also compiles a stub, a
kernel with the same arguments whose body is only the digest of all that was read, and at its end
puts the compiled kernel in place of the stub's file. A process that finds the same values traces
only the stub.

A stub is used only if Taichi reads it from a file with the contents that were put there. A kernel
for which the front end reads something without a digest has no stub.
"""

import contextlib
import functools
import hashlib
import json
import linecache
import os
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from types import BuiltinFunctionType, FunctionType, MethodType, ModuleType
from typing import Any

import numpy as np
import taichi as ti
from taichi.lang.matrix import MatrixType
from taichi.lang.struct import StructType

from msph.front_end import logged, recorded, replaced
from msph.taichi_internals import core

# Taichi's files of compiled kernels in its cache folder, and the folder of the records there.
SUFFIX, RECORDS = ".tic", "stubs"
# Most records of one kernel: of scenes with other fields or bodies.
MOST_RECORDS = 8
# Bits of a number in the body of a stub: of a positive 32-bit integer.
WORD = 30
# Files that decide what the front end does besides those of the kernels.
OWN_FILES = ("stubs.py", "front_end.py", "launches.py", "taichi_internals.py", "taichi_matrices.py")
# Packages whose modules, functions and types depend on their versions only.
FOREIGN = ("taichi", "builtins", "math", "numpy")


class UnknownValueError(Exception):
    """The front end read a value without a digest."""


class Record:
    """What the front end reads while it traces a kernel with these template arguments: digests by
    path, and files of source. A path is the place of an argument, or "module:name", and names of
    attributes."""

    def __init__(self, arguments: list[Any]):
        self.digests: dict[tuple[str, ...], str] = {}
        self.files: set[str] = set()
        self.failure = ""
        # Paths of objects by id. Objects are kept, so that no other one gets the same id.
        self._paths: dict[int, tuple[str, ...]] = {}
        self._kept: list[Any] = []
        for place, argument in enumerate(arguments):
            self._add((str(place),), argument)

    def _add(self, path: tuple[str, ...], value: Any) -> None:
        try:
            self.digests[path] = digest(value)
        except UnknownValueError as error:
            self.failure = self.failure or f"{'.'.join(path)}: {error}"
        self._paths.setdefault(id(value), path)
        self._kept.append(value)

    def add_file(self, name: str) -> None:
        """Adds a file of source."""
        self.files.add(name)

    def add_name(self, function: FunctionType, name: str, value: Any) -> None:
        """Adds a global name of a function."""
        if function.__closure__ and name in function.__code__.co_freevars:
            self.failure = self.failure or f"{name} is a variable of an outer function"
        elif not is_foreign(value):
            self._add((f"{function.__module__}:{name}",), value)

    def add_attribute(self, owner: Any, name: str, value: Any) -> None:
        """Adds an attribute of an object, except of Taichi's expressions and modules."""
        if isinstance(owner, ModuleType):
            if not is_foreign(owner):
                self._add((f"{owner.__name__}:{name}",), value)
        elif isinstance(owner, ti.Field) or not is_foreign(type(owner)):
            if id(owner) in self._paths:
                self._add((*self._paths[id(owner)], name), value)
            else:
                self.failure = self.failure or f"{type(owner).__name__}.{name} has no path"

    def as_json(self) -> dict[str, Any]:
        """Returns the digests as [path, digest], and the digests of the files."""
        return {
            "values": [[list(path), digest] for path, digest in self.digests.items()],
            "files": {name: file_digest(name) for name in sorted(self.files)},
        }


def is_foreign(value: Any) -> bool:
    """Returns True for modules, functions and classes of Taichi, Python and NumPy, whose instances
    (struct types, matrices, fields) are values of this program."""
    if not isinstance(value, ModuleType | type | FunctionType | BuiltinFunctionType):
        return False
    module = value.__name__ if isinstance(value, ModuleType) else getattr(value, "__module__", "")
    return str(module).split(".")[0] in FOREIGN


def digest(value: Any) -> str:
    """Returns a text that differs for values which a kernel's code may distinguish. Raises
    UnknownValueError."""
    if value is None or isinstance(value, bool | int | float | str):
        return f"{type(value).__name__} {value!r}"
    if isinstance(value, np.generic):
        return f"{value.dtype} {value!r}"
    if isinstance(value, np.ndarray):
        return f"{value.dtype} {value.shape} {hashlib.sha256(value.tobytes()).hexdigest()}"
    if isinstance(value, tuple | list):
        return f"{type(value).__name__} [{', '.join(map(digest, value))}]"
    if isinstance(value, ti.Matrix):
        return f"matrix {value.to_list()}"
    if isinstance(value, ti.Field):
        return field_digest(value)
    return _type_digest(value)


def _type_digest(value: Any) -> str:
    """Returns the digest of a type, a function, a module or an object of this program."""
    if isinstance(value, StructType):
        members = ", ".join(f"{name}: {digest(kind)}" for name, kind in value.members.items())
        methods = ", ".join(f"{name}: {digest(m)}" for name, m in value.methods.items())
        return f"struct {{{members}}} {{{methods}}}"
    if isinstance(value, MatrixType):
        return f"{type(value).__name__} {value.n} {value.m} {value.dtype}"
    if isinstance(value, core.DataType):
        return str(value)
    if isinstance(value, ModuleType):
        return value.__name__
    name = f"{getattr(value, '__module__', '')}.{getattr(value, '__qualname__', '')}"
    if isinstance(value, FunctionType | MethodType):
        if getattr(value, "_is_taichi_function", False) or is_foreign(value):
            return name
        raise UnknownValueError(f"{name} is a function of Python")
    if isinstance(value, type):
        return name
    own = type(value).__module__.startswith("msph.")
    if own or getattr(type(value), "_data_oriented", False):
        return f"{type(value).__module__}.{type(value).__qualname__}"
    raise UnknownValueError(f"{type(value).__name__} has no digest")


def field_digest(field: ti.Field) -> str:
    """Returns the digest of a field: its place in memory."""
    nodes = [member.ptr.snode() for member in field._get_field_members()]
    sizes = [getattr(field, name, "") for name in ("n", "m")]
    return f"{type(field).__name__} {sizes} [{', '.join(map(_node_digest, nodes))}]"


# Digests of nodes by their numbers.
_nodes: dict[int, str] = {}


def _node_digest(node: Any) -> str:
    """Returns the digest of a node of Taichi's field trees and the nodes above it."""
    if node.id not in _nodes:
        levels, level = [], node
        while level is not None:
            edges = [level.get_shape_along_axis(k) for k in range(level.num_active_indices())]
            kind = level.data_type() if level.is_place() else level.type
            place = level.offset_bytes_in_parent_cell, level.cell_size_bytes
            levels.append(f"{level.id} {kind} {place} {edges}")
            level = level.parent
        _nodes[node.id] = f"{node.get_snode_tree_id()}: {' < '.join(levels)}"
    return _nodes[node.id]


def file_contents(path: Path) -> str:
    """Returns the digest of a file, "" if it does not exist."""
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError:
        return ""


@functools.cache
def file_digest(name: str) -> str:
    """Returns the digest of a file of source, of the lines that the front end has read or will
    read, also if the file changes while the process runs."""
    return hashlib.sha256("".join(linecache.getlines(name)).encode()).hexdigest()


def _read(path: list[str], arguments: list[Any]) -> Any:
    """Returns the value at a path. Raises LookupError or AttributeError."""
    root, *names = path
    if root.isdigit():
        found = arguments[int(root)]
    else:
        module, name = root.split(":")
        found = vars(sys.modules[module])[name]
    return functools.reduce(getattr, names, found)


def _fits(record: dict[str, Any], arguments: list[Any]) -> bool:
    """Returns True if all that a record names is as it was."""
    try:
        return all(
            digest(_read(path, arguments)) == known for path, known in record["values"]
        ) and all(file_digest(name) == known for name, known in record["files"].items())
    except (LookupError, AttributeError, TypeError, ValueError, UnknownValueError):
        return False


def _body(kernel: str, record: dict[str, Any], result: str) -> str:
    """Returns the body of the stub of a kernel's record, which returns `result`: the digest of
    both, in numbers that have no effect."""
    text = json.dumps([kernel, record["values"], record["files"]]).encode()
    number = int.from_bytes(hashlib.sha256(text).digest(), "big")
    words = [(number >> shift) & ((1 << WORD) - 1) for shift in range(0, 256, WORD)]
    lines = [f"_{k} = {word}" for k, word in enumerate(words)]
    return "; ".join([*lines, f"return {result}"] if result else lines)


class Stubs:
    """Stubs in a folder of Taichi's cache. written: records of this process with the keys of their
    kernels and stubs, for keep()."""

    def __init__(self, folder: Path):
        self.folder, self.records = folder, folder / RECORDS
        self.written: list[tuple[Path, dict[str, Any], str, str]] = []
        own = (file_digest(str(Path(__file__).with_name(name))) for name in OWN_FILES)
        self._environment = [ti.__version__, sys.version, np.__version__, *own]

    def compiled(
        self,
        identity: list[Any],
        arguments: list[Any],
        result: str,
        trace: Callable[[bool], Any],
        compile_: Callable[[Any], Any],
    ) -> tuple[Any, Any]:
        """Returns a kernel, or its stub, and the compiled kernel.

        identity: of the kernel and the compiler's options; arguments: template arguments; result:
        code of a result of the kernel's type, "" for none; trace(stub) traces the kernel or a copy
        of it, which becomes the stub; compile_(kernel) compiles it.
        """
        text = json.dumps([*self._environment, *identity], default=str)
        path = self.records / f"{hashlib.sha256(text.encode()).hexdigest()}.json"
        fitting = (record for record in read_records(path) if _fits(record, arguments))
        known = next(fitting, None)
        if known and self._is_intact(known):
            with replaced(_body(path.stem, known, result)):
                stub = trace(True)
            compiled, read, key = logged(lambda: compile_(stub))
            if read and key == known["stub"] and self._is_intact(known):
                return stub, compiled
        reads = Record(arguments)
        with recorded(reads):
            kernel = trace(False)
        compiled, _, key = logged(lambda: compile_(kernel))
        if key and not reads.failure:
            record = reads.as_json()
            with replaced(_body(path.stem, record, result)):
                stub = trace(True)
            self.written.append((path, record, key, logged(lambda: compile_(stub))[2]))
        return kernel, compiled

    def _is_intact(self, record: dict[str, Any]) -> bool:
        """Returns True if the stub's file has the contents that were put there."""
        path = self.folder / (record["stub"] + SUFFIX)
        return file_contents(path) == record["contents"]

    def keep(self) -> None:
        """Puts the compiled kernels of this process in place of their stubs, once Taichi has
        written its files at its end."""
        for path, record, kernel, stub in self.written:
            with contextlib.suppress(OSError):
                contents = (self.folder / (kernel + SUFFIX)).read_bytes()
                _write(self.folder / (stub + SUFFIX), contents)
                known = {"stub": stub, "contents": hashlib.sha256(contents).hexdigest()}
                others = [r for r in read_records(path) if r["values"] != record["values"]]
                self.records.mkdir(exist_ok=True)
                _write(path, json.dumps([record | known, *others][:MOST_RECORDS]).encode())
        self.written.clear()


def read_records(path: Path) -> list[dict[str, Any]]:
    """Returns the records in a file, none if it does not exist or is damaged."""
    try:
        found = json.loads(path.read_bytes())
    except (OSError, ValueError):
        found = []
    return found if isinstance(found, list) else []


def _write(path: Path, contents: bytes) -> None:
    """Writes a file as a whole, since other processes may read it."""
    with tempfile.NamedTemporaryFile(dir=path.parent, delete=False) as file:
        file.write(contents)
    os.replace(file.name, path)
