"""Declaration of parameters: default, range, unit and help text in one place.

Sections declare the parameters of the solvers, the renderer, scene files and lesson files. Input
checks, `--set`, sliders, `msph scenes --parameters` and written scenes are derived from them.
"""

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, field_validator
from pydantic_core import PydanticCustomError

# Largest absolute value of any number (-): squares and products of several stay finite.
LARGEST = 1e12
# Largest speed of water, bodies and tanks [m/s]; the speed of sound in water is 1480 m/s.
MAX_SPEED = 500.0
# Shortest period of a motion [s], which steps must resolve, and longest duration [s], 11 days.
SHORTEST, LONGEST = 0.01, 1e6

Number = Annotated[float, Field(strict=True)]
Vector = Annotated[tuple[Number, Number, Number], Field(strict=False)]


class Section(BaseModel):
    """A table of parameters; unknown keys, wrong types, NaN and numbers beyond LARGEST are
    errors."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)

    @field_validator("*")
    @classmethod
    def _limited(cls, value: Any) -> Any:
        parts = value if isinstance(value, tuple) else (value,)
        if any(isinstance(n, int | float) and abs(n) > LARGEST for n in parts):
            raise PydanticCustomError("limit", f"must be -{LARGEST:g} to {LARGEST:g}")
        return value


def parameter(
    default: Any = ...,
    *,
    unit: str = "-",
    text: str,
    live: tuple[float, float] | None = None,
    label: str = "",
    **limits: Any,
) -> Any:
    """Declares a parameter of a Section; it is required if the default is `...`.

    limits: gt, ge, lt, le, lengths, pattern, as in pydantic. live: slider range of a parameter that
    may change while the simulation runs; for a vector, the range of its length. label: name of the
    slider, by default the key."""
    extra: dict[str, Any] = {"unit": unit, "live": live, "label": label}
    if callable(default):
        return Field(default_factory=default, description=text, json_schema_extra=extra, **limits)
    return Field(default, description=text, json_schema_extra=extra, **limits)
