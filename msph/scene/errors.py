"""The error of a scene: one line that names the file, the key and the problem."""

import contextlib
from collections.abc import Collection, Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from msph.errors import BadInputError, did_you_mean

# Largest overlap [m] of volumes of water, or with the outside of the box, that counts as rounding.
TOLERANCE = 1e-6


class SceneError(BadInputError):
    """A scene that cannot be used; str() is one line for the user: file, key, problem."""

    def __init__(self, where: str, problem: str, key: str = ""):
        self.where, self.key, self.problem = where, key, problem
        super().__init__(": ".join(part for part in (where, key, problem) if part))


def require(holds: object, key: str, problem: str) -> None:
    """Raises SceneError for a key unless a condition holds; in_file() adds the file."""
    if not holds:
        raise SceneError("", problem, key)


def require_known(name: str, known: Collection[str], what: str, key: str) -> None:
    """Raises SceneError for a key that gives an unknown name."""
    if name not in known:
        raise SceneError("", f"unknown {what} {name!r}; {did_you_mean(name, known)}", key)


@contextlib.contextmanager
def in_file(where: str) -> Iterator[None]:
    """Context that adds the name of the scene's file to a SceneError."""
    try:
        yield
    except SceneError as error:
        raise SceneError(where, error.problem, error.key) from None


@contextlib.contextmanager
def explaining(key: str) -> Iterator[None]:
    """Context that turns an error of input into a SceneError of a key."""
    try:
        yield
    except BadInputError as error:
        raise SceneError("", str(error), key) from None


def in_metres(point: Iterable[float]) -> str:
    """Formats a point or an extent [m] for messages."""
    return "(" + ", ".join(f"{v:g}" for v in point) + ") m"


def is_one_of(*shapes: tuple[Any, ...]) -> bool:
    """Returns True if all keys of one shape are given, and no key of another shape."""
    given = [shape for shape in shapes if any(key is not None for key in shape)]
    return len(given) == 1 and all(key is not None for key in given[0])


def require_inside(lo: np.ndarray, hi: np.ndarray, size: Sequence[float], key: str) -> None:
    """Raises SceneError if corners (3,) [m] are outside the box."""
    inside = np.all(lo >= -TOLERANCE) and np.all(hi <= np.array(size) + TOLERANCE)
    reach = f"{in_metres(lo)} to {in_metres(hi)}"
    require(inside, key, f"reaches from {reach}, outside the box of {in_metres(size)}")


def require_layer(index: int, layers: int, key: str) -> None:
    """Raises SceneError if a layer's index is not below the number of layers."""
    problem = f"must be a layer's index from 0 to {layers - 1} (got {index})"
    require(index < layers, f"{key}.layer", problem)
