"""Values that are remembered between runs, in the user's cache: progress in lessons."""

import contextlib
import json
import os
from pathlib import Path
from typing import Any

import platformdirs

import msph


def file() -> Path:
    """Where it is kept: one file for each version."""
    return platformdirs.user_cache_path("msph") / f"measured-{msph.__version__}.json"


def _read() -> dict[str, Any]:
    try:
        found = json.loads(file().read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


def recall(key: str, default: Any = None) -> Any:
    """The value remembered under a key, or the default."""
    return _read().get(key, default)


def remember(key: str, value: Any) -> None:
    """Keeps a value, if the cache can be written."""
    known = _read()
    if known.get(key) == value:
        return
    with contextlib.suppress(OSError):
        file().parent.mkdir(parents=True, exist_ok=True)
        # Another run must never read half a file, nor write into the same.
        part = file().with_suffix(f".{os.getpid()}.part")
        part.write_text(json.dumps(known | {key: value}, indent=1) + "\n", encoding="utf-8")
        part.replace(file())
