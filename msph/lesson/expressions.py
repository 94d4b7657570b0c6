"""Expressions of a lesson, over waters, sliders and boards; simpleeval reads them."""

import ast
import math
import re
from collections.abc import Mapping
from typing import Any

import numpy as np
from simpleeval import InvalidExpression, SimpleEval

from msph.errors import did_you_mean

# Functions that expressions may call, and a number with which they are tried.
FUNCTIONS = {"abs": abs, "min": min, "max": max}
SOME = 1.234567


class ExpressionError(ValueError):
    """An expression that cannot be read, in one line."""


def check(text: str, known: Mapping[str, set[str] | None]) -> None:
    """Raises ExpressionError where an expression is none, or uses what is not known: names, each
    with its attributes, or None for a number."""
    try:
        tree = ast.parse(text, mode="eval")
    except (SyntaxError, ValueError, RecursionError):
        hint = "; == compares" if re.search(r"[^=<>!]=[^=]", text) else ""
        raise ExpressionError(f"is no expression: {text!r}{hint}") from None
    named = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
    called = {id(node.func) for node in ast.walk(tree) if isinstance(node, ast.Call)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute):
            owner = node.value.id if isinstance(node.value, ast.Name) else ""
            _demand(owner, known, "name")
            _demand(node.attr, known[owner] or (), f"number of {owner!r}")
        elif isinstance(node, ast.Name) and id(node) in called:
            _demand(node.id, FUNCTIONS, "function")
        elif isinstance(node, ast.Name):
            _demand(node.id, known, "name")
            if known[node.id] is not None and id(node) not in named:
                raise ExpressionError(f"{node.id!r} is no number; say {node.id}.NUMBER")
    found = value(text, {name: _Some() if inner else SOME for name, inner in known.items()})
    if found != found:
        raise ExpressionError(f"is no number: {text!r}")


def value(text: str, names: Mapping[str, Any]) -> bool | float:
    """What an expression amounts to: True, False or a number, NaN where it cannot be computed with
    these values. Raises ExpressionError."""
    try:
        # It adds to the functions that it is given.
        found = SimpleEval(names=dict(names), functions=dict(FUNCTIONS)).eval(text)
    except InvalidExpression as error:
        raise ExpressionError(f"{text!r}: {error}") from None
    except (ArithmeticError, TypeError, ValueError):
        return math.nan
    if isinstance(found, bool | np.bool_):
        return bool(found)
    return float(found) if isinstance(found, int | float | np.number) else math.nan


def _demand(name: str, known: Any, what: str) -> None:
    if name in known:
        return
    raise ExpressionError(f"unknown {what} {name!r}; {did_you_mean(name, known)}")


class _Some:
    """Whose every attribute is some number."""

    def __getattr__(self, name: str) -> float:
        return SOME
