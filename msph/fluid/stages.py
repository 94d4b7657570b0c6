"""Stages of a step by name: the hook of a profiler, free where there is none."""

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext

# stage(name) gives the context in which the work of that name is done.
Stage = Callable[[str], AbstractContextManager]

_nothing = nullcontext()


def no_stage(name: str) -> AbstractContextManager:
    """The stage of which nobody takes the time."""
    return _nothing
