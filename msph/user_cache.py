"""Values kept between runs in the user's cache folder: lesson progress, self-test outcomes, and
qualities that run in real time."""

import contextlib
import json
import os
from pathlib import Path
from typing import Any, TypeVar

import click
import platformdirs

from msph.constants import VERSION

T = TypeVar("T")


def file() -> Path:
    """Returns the path of the cache file of this version."""
    return platformdirs.user_cache_path("msph") / f"measured-{VERSION}.json"


def recall(key: str, kind: type[T]) -> T | None:
    """Returns the value stored under a key, or None. A value that pydantic cannot validate as the
    type `kind` is reported in one line and removed."""
    from pydantic import TypeAdapter, ValidationError

    known = _read()
    if key not in known:
        return None
    try:
        return TypeAdapter(kind).validate_python(known[key])
    except ValidationError:
        _report(f"the value of {key!r} is damaged and is replaced")
        forget(key)
        return None


def remember(key: str, value: Any) -> None:
    """Stores a value that JSON can hold, if the cache can be written."""
    known = _read()
    if key not in known or known[key] != value:
        _write(known | {key: value})


def forget(key: str) -> None:
    """Removes the value stored under a key, if any."""
    known = _read()
    if key in known:
        _write({name: value for name, value in known.items() if name != key})


def _read() -> dict[str, Any]:
    # Imported in functions, since the command line's help needs no pydantic.
    from pydantic import TypeAdapter, ValidationError

    try:
        return TypeAdapter(dict[str, Any]).validate_json(file().read_bytes())
    except OSError:
        return {}
    except ValidationError:
        _report("is damaged and is replaced")
        _write({})
        return {}


def _write(known: dict[str, Any]) -> None:
    with contextlib.suppress(OSError):
        file().parent.mkdir(parents=True, exist_ok=True)
        # A temporary file per process: concurrent runs must not read or write a partial file.
        part = file().with_suffix(f".{os.getpid()}.part")
        part.write_text(json.dumps(known, indent=1) + "\n", encoding="utf-8")
        part.replace(file())


def _report(problem: str) -> None:
    click.echo(f"msph: {file()}: {problem}", err=True)
