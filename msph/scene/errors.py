"""The error of a scene: one line that names the file, the key and the problem."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from msph.errors import BadInputError

# Largest overlap [m] of volumes of water, or with the outside of the box, that counts as rounding.
TOLERANCE = 1e-6


class SceneError(BadInputError):
    """A scene that cannot be used; str() is one line for the user: file, key, problem."""

    def __init__(self, where: str, problem: str, key: str = ""):
        self.where, self.key, self.problem = where, key, problem
        super().__init__(": ".join(part for part in (where, key, problem) if part))


def in_metres(point: Iterable[float]) -> str:
    """Formats a point or an extent [m] for messages."""
    return "(" + ", ".join(f"{v:g}" for v in point) + ") m"


def is_one_of(*shapes: tuple[Any, ...]) -> bool:
    """Returns True if all keys of one shape are given, and no key of another shape."""
    given = [shape for shape in shapes if any(key is not None for key in shape)]
    return len(given) == 1 and all(key is not None for key in given[0])


def check_inside(
    lo: np.ndarray, hi: np.ndarray, size: Sequence[float], where: str, key: str
) -> None:
    """Raises SceneError if corners (3,) [m] are outside the box."""
    if np.any(lo < -TOLERANCE) or np.any(hi > np.array(size) + TOLERANCE):
        problem = f"reaches from {in_metres(lo)} to {in_metres(hi)}, outside the box of "
        raise SceneError(where, problem + in_metres(size), key)
