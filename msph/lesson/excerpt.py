"""Excerpts of this program's source, read at run time so that they stay up to date."""

import importlib
import inspect
import textwrap
from pathlib import Path
from typing import Any

from msph.errors import BadInputError

OWN = "msph"


class ExcerptError(BadInputError):
    """Source code that cannot be found; str() names it."""


def excerpt(code: str, first: str = "", last: str = "") -> list[str]:
    """Returns the lines of the function, class or module `module:name`, from the first line with
    `first` to the next line with `last`. Raises ExcerptError."""
    module, _, name = code.partition(":")
    if module.partition(".")[0] != OWN:
        raise ExcerptError(f"{code} is not part of {OWN}")
    try:
        found: Any = importlib.import_module(module)
        for part in name.split(".") if name else ():
            found = found.__dict__[part]
        lines = _source(found)
    except (ImportError, KeyError, AttributeError, ValueError, TypeError, OSError):
        raise ExcerptError(f"no source found for {code}") from None
    begin = _line(lines, first, 0, code) if first else 0
    end = _line(lines, last, begin, code) if last else len(lines) - 1
    return textwrap.dedent("\n".join(lines[begin : end + 1])).rstrip().splitlines()


def _source(found: Any) -> list[str]:
    # Taichi's wrappers and properties keep the function in one of these attributes.
    for inner in ("__wrapped__", "func", "fn", "fget"):
        found = getattr(found, inner, found)
    if inspect.ismodule(found):
        return Path(str(found.__file__)).read_text(encoding="utf-8").splitlines()
    return inspect.getsource(found).splitlines()


def _line(lines: list[str], text: str, begin: int, code: str) -> int:
    place = next((k for k in range(begin, len(lines)) if text in lines[k]), None)
    if place is None:
        raise ExcerptError(f"{code} has no line with {text!r}")
    return place
