"""Expressions of lessons over simulations, and of scenes over time, evaluated by simpleeval."""

import ast
import math
import re
from collections.abc import Mapping
from typing import Any

import numpy as np
from simpleeval import InvalidExpression, SimpleEval

from msph.errors import did_you_mean

# Functions that expressions may call in lessons, and in scenes; value of every name in a trial
# evaluation.
FUNCTIONS: dict[str, Any] = {"abs": abs, "min": min, "max": max}
MATHEMATICS = ("sin", "cos", "tan", "atan", "sinh", "cosh", "tanh", "exp", "log", "sqrt", "floor")
TIMED_FUNCTIONS = FUNCTIONS | {name: getattr(math, name) for name in MATHEMATICS}
TRIAL_VALUE = 1.234567


class ExpressionError(ValueError):
    """An invalid expression; str() is one line."""


def check(
    text: str,
    known: Mapping[str, set[str] | None],
    functions: Mapping[str, Any] = FUNCTIONS,
) -> None:
    """Raises ExpressionError for an expression that is invalid or uses unknown names; known: names
    with their attributes, or None for a number."""
    try:
        tree = ast.parse(text, mode="eval")
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        hint = "; == compares" if re.search(r"[^=<>!]=[^=]", text) else ""
        raise ExpressionError(f"is not an expression: {text!r}{hint}") from None
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
    trial = {name: _Trial() if inner else TRIAL_VALUE for name, inner in known.items()}
    found = value(text, trial, functions)
    if found != found:
        raise ExpressionError(f"is not a number: {text!r}")


def value(
    text: str, names: Mapping[str, Any], functions: Mapping[str, Any] = FUNCTIONS
) -> bool | float:
    """Returns the value of an expression: True, False or a number, NaN if undefined for these
    values. Raises ExpressionError."""
    try:
        # Copied, as SimpleEval adds functions to the dictionary.
        found = SimpleEval(names=dict(names), functions=dict(functions)).eval(text)
    except InvalidExpression as error:
        raise ExpressionError(f"{text!r}: {error}") from None
    except RecursionError:
        raise ExpressionError(f"{text!r}: has too many nested parts") from None
    except (ArithmeticError, TypeError, ValueError):
        return math.nan
    if isinstance(found, bool | np.bool_):
        return bool(found)
    return float(found) if isinstance(found, int | float | np.number) else math.nan


class OverTime:
    """A number that is constant, or an expression of the time t [s]; parsed once, and a constant is
    evaluated once.

    Raises ExpressionError for an invalid expression.
    """

    def __init__(self, given: float | str):
        self.text = str(given)
        self._names: dict[str, float] = {"t": 0.0, "pi": math.pi}
        check(self.text, dict.fromkeys(self._names), TIMED_FUNCTIONS)
        self._tree = SimpleEval.parse(self.text)
        self._evaluator = SimpleEval(names=self._names, functions=dict(TIMED_FUNCTIONS))
        names = {node.id for node in ast.walk(self._tree) if isinstance(node, ast.Name)}
        self._constant = None if "t" in names else self._evaluate(0.0)

    def __call__(self, time: float) -> float:
        """Returns the value at a time [s], NaN if it is undefined."""
        return self._evaluate(time) if self._constant is None else self._constant

    def _evaluate(self, time: float) -> float:
        self._names["t"] = time
        try:
            return float(self._evaluator.eval(self.text, previously_parsed=self._tree))
        except (InvalidExpression, ArithmeticError, TypeError, ValueError):
            return math.nan


def _demand(name: str, known: Any, what: str) -> None:
    if name in known:
        return
    raise ExpressionError(f"unknown {what} {name!r}; {did_you_mean(name, known)}")


class _Trial:
    """Object whose every attribute is TRIAL_VALUE."""

    def __getattr__(self, name: str) -> float:
        return TRIAL_VALUE
