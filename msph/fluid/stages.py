"""Named stages of a step: a profiler hook without cost when unused."""

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext

# stage(name) returns the context in which the work of that name is done.
Stage = Callable[[str], AbstractContextManager]

_nothing = nullcontext()


def no_stage(name: str) -> AbstractContextManager:
    """Returns a context that does nothing."""
    return _nothing
