"""How a parameter is declared, once: its default, range, unit and help beside its name.

The fluid's and the picture's parameters are fields of dataclasses declared so; the sections of a
scene file are made from them, see msph.scene.schema.
"""

from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Declared:
    """What a declaration says beside the default: unit, help, limits as pydantic names them, and
    where it may change while the water moves, the range of its slider."""

    unit: str
    text: str
    limits: dict[str, float]
    live: tuple[float, float] | None


def parameter(
    default: Any,
    *,
    unit: str = "-",
    text: str,
    live: tuple[float, float] | None = None,
    **limits: float,
) -> Any:
    """A dataclass field that scenes can set. limits: gt, ge, lt, le. live: the range of its slider
    where it may change while the water moves."""
    return field(default=default, metadata={"declared": Declared(unit, text, limits, live)})
