"""Sums and products of small matrices as plain expressions, in place of Taichi's own functions.

Taichi writes sums over components (norm, dot, max) and matrix products as functions in its own
language, which its front end inlines at each call, node by node: a quarter of all syntax nodes of a
scene with bodies. The expressions built here are the same, without local variables.
"""

import functools
from collections.abc import Callable
from typing import Any

from taichi.lang import impl, matrix_ops
from taichi.lang.expr import Expr
from taichi.lang.matrix import make_matrix
from taichi.lang.matrix_ops_utils import check_matmul, preconditions

_reduce_by_taichi, _multiply_by_taichi = matrix_ops._reduce, matrix_ops._matmul_helper


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


def use() -> None:
    """Replaces Taichi's functions."""
    # Taichi warns of functions of other modules.
    reduce_matrix.__module__ = multiply.__module__ = matrix_ops.__name__
    matrix_ops._reduce = reduce_matrix
    matrix_ops._matmul_helper = preconditions(check_matmul)(multiply)
