"""Sums and products of small matrices as plain expressions, in place of Taichi's own functions.

Taichi writes sums over components (norm, dot, max), products, transposes and clamp() as functions
in its own language, which its front end inlines at each call, node by node: a third of all syntax
nodes of a scene with bodies. The expressions built here are the same, without local variables.
"""

import functools
import inspect
from collections.abc import Callable
from typing import Any

import taichi as ti
from taichi.lang import impl, matrix_ops, ops
from taichi.lang.expr import Expr
from taichi.lang.matrix import make_matrix
from taichi.lang.matrix_ops_utils import check_matmul, preconditions

_reduce_by_taichi, _multiply_by_taichi = matrix_ops._reduce, matrix_ops._matmul_helper
_cross_by_taichi, _transpose_by_taichi = matrix_ops.cross, matrix_ops.transpose
# Functions whose code builds the same expressions if Python runs that code.
RUN_BY_PYTHON = "sum", "norm_sqr", "norm", "dot", "max", "min", "matmul"


def _components(matrix: Expr) -> Any:
    """Returns the components of a vector, or a list of the rows of a matrix."""
    value, shape = impl.expr_init(matrix), matrix.get_shape()
    if len(shape) == 1:
        return [impl.subscript(None, value, i) for i in range(shape[0])]
    rows, columns = shape
    return [[impl.subscript(None, value, i, j) for j in range(columns)] for i in range(rows)]


def reduce_matrix(matrix: Any, function: Callable) -> Any:
    """Returns function(...function(a, b)..., z) of the components a, b, ..., z."""
    if not isinstance(matrix, Expr):
        return _reduce_by_taichi(matrix, function)
    found = _components(matrix)
    flat = found if len(matrix.get_shape()) == 1 else [value for row in found for value in row]
    return functools.reduce(function, flat)


def multiply(x: Any, y: Any) -> Any:
    """Returns the product of a matrix x and a matrix or vector y, or of two vectors."""
    if not (isinstance(x, Expr) and isinstance(y, Expr)) or len(x.get_shape()) == 1:
        return _multiply_by_taichi(x, y)
    rows, right = _components(x), _components(y)

    def dot(row: list[Any], column: list[Any]) -> Any:
        terms = [a * b for a, b in zip(row, column, strict=True)]
        return functools.reduce(lambda a, b: a + b, terms)

    if len(y.get_shape()) == 1:
        found = [dot(row, right) for row in rows]
    else:
        columns = list(zip(*right, strict=True))
        found = [[dot(row, column) for column in columns] for row in rows]
    return impl.expr_init(make_matrix(found))


def cross(x: Any, y: Any) -> Any:
    """Returns the cross product of two vectors."""
    if not all(isinstance(v, Expr) and v.get_shape() == (3,) for v in (x, y)):
        return _cross_by_taichi(x, y)
    a, b = _components(x), _components(y)
    found = [a[k - 2] * b[k - 1] - a[k - 1] * b[k - 2] for k in range(3)]
    return impl.expr_init(make_matrix(found))


def transpose(matrix: Any) -> Any:
    """Returns the transpose of a matrix."""
    if not (isinstance(matrix, Expr) and len(matrix.get_shape()) == 2):
        return _transpose_by_taichi(matrix)
    columns = zip(*_components(matrix), strict=True)
    return impl.expr_init(make_matrix([list(column) for column in columns]))


def clamp(x: Any, low: Any, high: Any) -> Any:
    """Returns x, at least `low` and at most `high`, by component."""
    return ops.min(high, ops.max(low, x))


def as_python(by_taichi: Callable) -> Callable:
    """Returns a function of vectors or matrices whose code Python runs, instead of Taichi's front
    end node by node."""
    body = inspect.unwrap(by_taichi)

    def call(*arguments: Any, **options: Any) -> Any:
        if not (isinstance(arguments[0], Expr) and arguments[0].is_tensor()):
            return by_taichi(*arguments, **options)
        return body(*(impl.expr_init(each) for each in arguments), **options)

    return call


def use() -> None:
    """Replaces Taichi's functions."""
    functions = {name: as_python(getattr(matrix_ops, name)) for name in RUN_BY_PYTHON}
    functions |= {"_reduce": reduce_matrix, "cross": cross, "transpose": transpose}
    # Taichi warns of functions of other modules.
    for function in (*functions.values(), multiply, clamp):
        function.__module__ = matrix_ops.__name__
    functions["_matmul_helper"] = preconditions(check_matmul)(multiply)
    vars(matrix_ops).update(functions)
    ti.math.clamp = clamp
