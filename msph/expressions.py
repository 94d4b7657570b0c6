"""Expressions of lessons over simulations, and of scenes over time, evaluated in floats.

An expression is Python's syntax of NODES, checked and compiled. Without integers no power or
product takes longer than another one.
"""

import ast
import functools
import math
import re
from collections.abc import Mapping
from types import CodeType, SimpleNamespace
from typing import Any

import numpy as np

from msph.errors import BadInputError, did_you_mean
from msph.parameter import LARGEST

# Functions that expressions may call in lessons, and in scenes; value of every name in a trial
# evaluation.
FUNCTIONS: dict[str, Any] = {"abs": abs, "min": min, "max": max}
MATHEMATICS = ("sin", "cos", "tan", "atan", "sinh", "cosh", "tanh", "exp", "log", "sqrt")
TIMED_FUNCTIONS = FUNCTIONS | {name: getattr(math, name) for name in MATHEMATICS}
TIMED_FUNCTIONS["floor"] = lambda x: float(math.floor(x))
TRIAL_VALUE = 1.234567
# Largest number of characters of an expression.
MAX_LENGTH = 1000
# Syntax of an expression.
NODES = (
    *(ast.Expression, ast.Constant, ast.Name, ast.Attribute, ast.Load, ast.Call, ast.IfExp),
    *(ast.BinOp, ast.Add, ast.Sub, ast.Mult, ast.Div, ast.FloorDiv, ast.Mod, ast.Pow),
    *(ast.UnaryOp, ast.USub, ast.UAdd, ast.Not, ast.BoolOp, ast.And, ast.Or),
    *(ast.Compare, ast.Eq, ast.NotEq, ast.Lt, ast.LtE, ast.Gt, ast.GtE),
)
# Name of the function in place of the operator **; no name in an expression can have it.
POWER = "**"
# Time [s] outside the duration of a scene at which an expression that is undefined there has the
# value of the start or the end: velocities are differences, and the last step may end later.
MARGIN = 0.1


class ExpressionError(BadInputError):
    """An invalid expression, or one without a possible value at a time."""


def check(
    text: str,
    known: Mapping[str, set[str] | None],
    functions: Mapping[str, Any] = FUNCTIONS,
) -> None:
    """Raises ExpressionError for an expression that is invalid, uses unknown names or is undefined
    in a trial; known: names with their attributes, or None for a number."""
    check_names(text, known, functions)
    trial = {
        name: SimpleNamespace(**dict.fromkeys(inner, TRIAL_VALUE)) if inner else TRIAL_VALUE
        for name, inner in known.items()
    }
    found = value(text, trial, functions)
    if found != found:
        raise ExpressionError(f"is not a number: {text!r}")


def check_names(
    text: str, known: Mapping[str, set[str] | None], functions: Mapping[str, Any]
) -> None:
    """Raises ExpressionError for an expression that is invalid or uses unknown names; see check."""
    tree = _parsed(text)
    named = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
    called = {id(node.func) for node in ast.walk(tree) if isinstance(node, ast.Call)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute):
            if not isinstance(node.value, ast.Name):
                raise ExpressionError(f"only names have numbers, not {ast.unparse(node.value)!r}")
            owner = node.value.id
            _demand(owner, known, "name")
            _demand(node.attr, known[owner] or (), f"number of {owner!r}")
        elif isinstance(node, ast.Name) and id(node) in called:
            _demand(node.id, functions, "function")
        elif isinstance(node, ast.Name):
            _demand(node.id, known, "name")
            if known[node.id] is not None and id(node) not in named:
                raise ExpressionError(f"{node.id!r} is not a number; write {node.id}.NUMBER")
    for node in ast.walk(tree):
        number = isinstance(node, ast.Constant) and isinstance(node.value, int | float)
        if not isinstance(node, NODES) or (isinstance(node, ast.Constant) and not number):
            raise ExpressionError(
                "may hold numbers, names, functions, comparisons and + - * / // % ** only: "
                f"{text!r}"
            )


def value(
    text: str, names: Mapping[str, Any], functions: Mapping[str, Any] = FUNCTIONS
) -> bool | float:
    """Returns the value of an expression that check() accepts: True, False or a number, NaN if
    undefined for these values."""
    scope = {"__builtins__": {}, POWER: math.pow, **functions, **names}
    try:
        found = eval(_compiled(text), scope)
    except (ArithmeticError, TypeError, ValueError, RecursionError):
        return math.nan
    if isinstance(found, bool | np.bool_):
        return bool(found)
    return float(found) if isinstance(found, int | float | np.number) else math.nan


class OverTime:
    """A number that is constant, or an expression of the time t [s] over a `duration` [s], between
    the limits `lo` and `hi`. key: of the expression, for messages.

    Raises ExpressionError for an invalid expression, and for a value outside the limits, also when
    a run needs the value at a time beyond the duration.
    """

    def __init__(
        self,
        given: float | str,
        duration: float,
        key: str = "",
        lo: float = -LARGEST,
        hi: float = LARGEST,
    ):
        self.text, self.given, self.duration, self.key = str(given), given, duration, key
        self.lo, self.hi = lo, hi
        try:
            check_names(self.text, {"t": None, "pi": None}, TIMED_FUNCTIONS)
            _compiled(self.text)
        except ExpressionError as error:
            raise self._error(str(error)) from None

    def __call__(self, time: float) -> float:
        """Returns the value at a time [s]."""
        found = self._at(time)
        if not math.isfinite(found):
            inside = min(max(time, 0.0), self.duration)
            found = self._at(inside) if abs(time - inside) <= MARGIN else math.nan
        if self.lo <= found <= self.hi:
            return found
        if not math.isfinite(found):
            raise self._error(f"{self.given!r} is not a number at t = {time:.3g} s")
        problem = f"must be {self.lo:g} to {self.hi:g}"
        if self.lo == 0.0 > found:
            problem = "must not be negative"
        raise self._error(f"is {found:.3g} at t = {time:.3g} s: {problem}")

    def _error(self, problem: str) -> ExpressionError:
        return ExpressionError(f"{self.key}: {problem}" if self.key else problem)

    def _at(self, time: float) -> float:
        return float(value(self.text, {"t": time, "pi": math.pi}, TIMED_FUNCTIONS))


class _Floats(ast.NodeTransformer):
    """Replaces integers by floats, and the operator ** by a function that returns floats."""

    def visit_Constant(self, node: ast.Constant) -> ast.Constant:
        # bool is a kind of int.
        return ast.Constant(float(node.value)) if type(node.value) is int else node

    def visit_BinOp(self, node: ast.BinOp) -> ast.AST:
        self.generic_visit(node)
        if isinstance(node.op, ast.Pow):
            return ast.Call(ast.Name(POWER, ast.Load()), [node.left, node.right], [])
        return node


@functools.lru_cache(1024)
def _parsed(text: str) -> ast.Expression:
    """Returns the syntax tree of an expression."""
    if len(text) > MAX_LENGTH:
        raise ExpressionError(f"has {len(text)} characters; at most {MAX_LENGTH} are allowed")
    try:
        return ast.parse(text.strip(), mode="eval")
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        hint = "; == compares" if re.search(r"[^=<>!]=[^=]", text) else ""
        raise ExpressionError(f"is not an expression: {text!r}{hint}") from None


@functools.lru_cache(1024)
def _compiled(text: str) -> CodeType:
    """Returns the code of an expression."""
    try:
        tree = _Floats().visit(ast.parse(text.strip(), mode="eval"))
        return compile(ast.fix_missing_locations(tree), "<expression>", "eval")
    except (RecursionError, MemoryError):
        raise ExpressionError(f"{text!r}: has too many nested parts") from None
    except OverflowError:
        raise ExpressionError(f"{text!r}: has a number that is too large") from None


def _demand(name: str, known: Any, what: str) -> None:
    if name not in known:
        raise ExpressionError(f"unknown {what} {name!r}; {did_you_mean(name, known)}")
