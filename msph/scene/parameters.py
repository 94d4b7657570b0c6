"""List of a section's declared parameters, for `msph scenes --parameters` and for sliders."""

from dataclasses import dataclass
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from msph.parameter import Section


@dataclass(frozen=True)
class Parameter:
    """A declared parameter as text: dotted key, type, default, unit, range, help, and the range and
    label of its slider."""

    key: str
    kind: str
    default: str
    unit: str
    limits: str
    text: str
    live: tuple[float, float] | None
    label: str

    def row(self) -> dict[str, str]:
        return {
            "parameter": self.key,
            "type": self.kind,
            "default": self.default,
            "unit": self.unit,
            "range": self.limits,
            "": self.text,
        }


def parameters(section: type[Section], prefix: str = "") -> list[Parameter]:
    """Returns the parameters of a section and its subsections; list items are named name.0."""
    found: list[Parameter] = []
    for name, info in section.model_fields.items():
        key, kinds = prefix + name, _kinds(info.annotation)
        inner = next((k for k in kinds if isinstance(k, type) and issubclass(k, Section)), None)
        if inner:
            listed = get_origin(info.annotation) is list
            found += parameters(inner, f"{key}.0." if listed else f"{key}.")
            continue
        extra = info.json_schema_extra if isinstance(info.json_schema_extra, dict) else {}
        limits = [
            f"{sign} {getattr(m, a)}" for m in info.metadata for a, sign in _SIGNS if hasattr(m, a)
        ]
        found.append(
            Parameter(
                key=key,
                kind=" | ".join(_kind_name(k) for k in kinds if k is not type(None)),
                default="required" if info.is_required() else _plain(info.default),
                unit=str(extra.get("unit", "-")),
                limits=", ".join(limits),
                text=info.description or "",
                live=extra.get("live"),  # type: ignore[arg-type]
                label=str(extra.get("label") or name.replace("_", " ")),
            )
        )
    return found


_SIGNS = (("gt", ">"), ("ge", ">="), ("lt", "<"), ("le", "<="))


def _kinds(annotation: Any) -> list[Any]:
    """Returns the types of an annotation, with Annotated, Optional, Literal and list unwrapped."""
    origin = get_origin(annotation)
    if origin is Annotated:
        return _kinds(get_args(annotation)[0])
    if origin in (Union, UnionType, list):
        return [k for a in get_args(annotation) for k in _kinds(a)]
    return list(get_args(annotation)) if origin is Literal else [annotation]


def _kind_name(kind: Any) -> str:
    if get_origin(kind) is tuple:
        return "[x, y, z]" if len(get_args(kind)) == 3 else "[x, z]"
    return kind.__name__ if isinstance(kind, type) else str(kind)


def _plain(value: Any) -> str:
    return "" if value is None else str(list(value) if isinstance(value, tuple) else value)
