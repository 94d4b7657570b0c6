"""Declarations of parameters: default, range, unit and help in one place.

Sections hold the parameters of fluid, picture, scene files and lesson files. From the declarations
come the checks of input, `--set`, sliders, `msph scenes --parameters` and written scenes.
"""

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field

Number = Annotated[float, Field(strict=True)]
Vector = Annotated[tuple[Number, Number, Number], Field(strict=False)]


class Section(BaseModel):
    """A table of parameters. Unknown keys, wrong types, NaN and infinity are errors."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)


def parameter(
    default: Any = ...,
    *,
    unit: str = "-",
    text: str,
    live: tuple[float, float] | None = None,
    **limits: Any,
) -> Any:
    """A parameter of a Section; `...` as default makes it required. limits: gt, ge, lt, le,
    lengths, pattern. live: range of its slider where it may change while the simulation runs, for
    vectors the range of the length."""
    extra: dict[str, Any] = {"unit": unit, "live": live}
    if callable(default):
        return Field(default_factory=default, description=text, json_schema_extra=extra, **limits)
    return Field(default, description=text, json_schema_extra=extra, **limits)
