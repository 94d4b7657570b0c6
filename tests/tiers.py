"""Marks parameters of tests as slow."""

from collections.abc import Iterable

import pytest


def slow_but(fast: Iterable, values: Iterable) -> list:
    """Returns the values as parameters of a test; all that are not fast are marked as slow."""
    return [
        value if value in fast else pytest.param(value, marks=pytest.mark.slow) for value in values
    ]
