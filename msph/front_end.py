"""Taichi's front end, which builds a kernel's syntax tree: what it reads, bodies in place of those
of kernels, and keys of compiled kernels in Taichi's cache. Not for plain Taichi."""

import ast
import contextlib
import os
import re
import sys
import tempfile
from collections.abc import Callable, Iterator
from typing import Any, Protocol

import taichi as ti

from msph.taichi_internals import ASTTransformer, ASTTransformerContext, kernel_impl

# Line of Taichi's log for a kernel that it reads from its cache ("Create") or compiles ("Cache").
LOG = re.compile(r"\b(Create|Cache) kernel '.*?' .*?\(key='(\w+)'\)")
# Lines of its log below the level of errors.
QUIET = re.compile(r"\[[TDIW] ")
# Name of the type of a kernel's result in the code that replaced() is given.
RESULT = "_result"


class Reader(Protocol):
    """What recorded() calls: for files of source, global names of functions, and attributes."""

    def add_file(self, name: str) -> None: ...

    def add_name(self, function: Any, name: str, value: Any) -> None: ...

    def add_attribute(self, owner: Any, name: str, value: Any) -> None: ...


# The reader, and the body of kernels, in the blocks of recorded() and replaced().
_reader: Reader | None = None
_body = ""


@contextlib.contextmanager
def recorded(reader: Reader) -> Iterator[None]:
    """Tells a reader what the front end reads in the block."""
    global _reader
    _reader = reader
    try:
        yield
    finally:
        _reader = None


@contextlib.contextmanager
def replaced(body: str) -> Iterator[None]:
    """Replaces the bodies of kernels that are traced in the block by one line of code."""
    global _body
    _body = body
    try:
        yield
    finally:
        _body = ""


def logged(compile_: Callable[[], Any]) -> tuple[Any, bool, str]:
    """Calls a function that compiles a kernel; returns its result, whether Taichi has read the
    kernel from its cache, and its key there, "" if unknown: Taichi tells it in its log only, on
    the standard error stream."""
    try:
        stderr = os.dup(2)
    except OSError:  # closed
        return compile_(), False, ""
    with tempfile.TemporaryFile() as file:
        _flush()
        os.dup2(file.fileno(), 2)
        ti.set_logging_level(ti.DEBUG)
        try:
            result = compile_()
        finally:
            ti.set_logging_level(ti.ERROR)
            _flush()
            os.dup2(stderr, 2)
            os.close(stderr)
            file.seek(0)
            text = file.read().decode(errors="replace")
            for line in text.splitlines() if sys.stderr else ():
                if not QUIET.match(line):
                    print(line, file=sys.stderr)
    found = LOG.findall(text)
    how, key = found[-1] if found else ("", "")
    return result, how == "Create", key


def _flush() -> None:
    if sys.stderr:
        sys.stderr.flush()


def _attribute(context: Any, node: Any) -> Any:
    """Builds an attribute of an object or of an expression."""
    result = build_attribute(context, node)
    if _reader:
        _reader.add_attribute(node.value.ptr, node.attr, result)
    return result


def _variable(context: Any, name: str) -> Any:
    """Returns the value of a name."""
    result = get_variable(context, name)
    if _reader and name in context.global_vars:
        if not any(name in scope for scope in context.local_scopes):
            _reader.add_name(context.func.func, name, context.global_vars[name])
    return result


def _transform(tree: Any, context: Any) -> Any:
    """Traces a function or kernel."""
    if _reader:
        _reader.add_file(context.file)
    if _body and context.is_kernel:
        tree.body[0].body = ast.parse(_body).body
        context.global_vars[RESULT] = (context.func.return_type or [None])[0]
    return transform(tree, context)


build_attribute, transform = ASTTransformer.build_Attribute, kernel_impl.transform_tree
get_variable = ASTTransformerContext.get_var_by_name
ASTTransformer.build_Attribute = staticmethod(_attribute)
ASTTransformerContext.get_var_by_name = _variable
kernel_impl.transform_tree = _transform
