"""How a parameter is declared, once: its default, range, unit and help beside its name.

The fluid's and the picture's parameters are fields of dataclasses declared so; the sections of a
scene file are made from them, see msph.scene.schema.
"""

from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Declared:
    """What a declaration says beside the default: unit, help, and limits as pydantic names them."""

    unit: str
    text: str
    limits: dict[str, float]


def parameter(default: Any, *, unit: str = "-", text: str, **limits: float) -> Any:
    """A dataclass field that scenes can set. limits: gt, ge, lt, le."""
    return field(default=default, metadata={"declared": Declared(unit, text, limits)})
