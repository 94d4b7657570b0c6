"""Expressions of a lesson, over waters, sliders and boards; simpleeval reads them."""

import ast
import difflib
from collections.abc import Mapping
from typing import Any

from simpleeval import EvalWithCompoundTypes, InvalidExpression

# Functions that expressions may call.
FUNCTIONS = {"abs": abs, "min": min, "max": max}


class ExpressionError(ValueError):
    """An expression that cannot be read, in one line."""


def check(text: str, known: Mapping[str, set[str] | None]) -> None:
    """Raises ExpressionError where an expression is none, or uses what is not known: names, each
    with its attributes, or None for a number."""
    try:
        tree = ast.parse(text, mode="eval")
    except (SyntaxError, ValueError, RecursionError):
        raise ExpressionError(f"is no expression: {text!r}") from None
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
    try:
        value(text, {name: _Ones() if inner else 1.0 for name, inner in known.items()})
    except ExpressionError:
        raise
    except (TypeError, ArithmeticError):
        raise ExpressionError(f"cannot be computed: {text!r}") from None


def uses(text: str) -> set[tuple[str, str]]:
    """Pairs of a name and its attribute, "" for a plain name."""
    tree = ast.parse(text, mode="eval")
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            found.add((node.value.id, node.attr))
        elif isinstance(node, ast.Name):
            found.add((node.id, ""))
    return found


def value(text: str, names: Mapping[str, Any]) -> Any:
    """What an expression amounts to; comparisons with NaN are false. Raises ExpressionError."""
    try:
        return EvalWithCompoundTypes(names=dict(names), functions=FUNCTIONS).eval(text)
    except InvalidExpression as error:
        raise ExpressionError(f"{text!r}: {error}") from None
    except ZeroDivisionError:
        return float("nan")


def _demand(name: str, known: Any, what: str) -> None:
    if name in known:
        return
    near = difflib.get_close_matches(name, list(known), n=1, cutoff=0.5)
    hint = f"did you mean {near[0]!r}?" if near else f"known: {', '.join(known) or 'none'}"
    raise ExpressionError(f"unknown {what} {name!r}; {hint}")


class _Ones:
    """Whose every attribute is one."""

    def __getattr__(self, name: str) -> float:
        return 1.0
