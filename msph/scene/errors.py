"""The one error that a scene can give: a line that names the file, the key and what is wrong."""

from collections.abc import Iterable

from msph.errors import BadInputError


class SceneError(BadInputError):
    """A scene that cannot be used. str() is one line fit to be shown to a person."""

    def __init__(self, where: str, problem: str, key: str = ""):
        self.where, self.key, self.problem = where, key, problem
        super().__init__(": ".join(part for part in (where, key, problem) if part))


def in_metres(point: Iterable[float]) -> str:
    """A point or an extent [m] as messages write it."""
    return "(" + ", ".join(f"{v:g}" for v in point) + ") m"
