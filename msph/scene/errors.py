"""The error of a scene: one line that names the file, the key and the problem."""

from collections.abc import Iterable

from msph.errors import BadInputError


class SceneError(BadInputError):
    """A scene that cannot be used; str() is one line for the user: file, key, problem."""

    def __init__(self, where: str, problem: str, key: str = ""):
        self.where, self.key, self.problem = where, key, problem
        super().__init__(": ".join(part for part in (where, key, problem) if part))


def in_metres(point: Iterable[float]) -> str:
    """Formats a point or an extent [m] for messages."""
    return "(" + ", ".join(f"{v:g}" for v in point) + ") m"
