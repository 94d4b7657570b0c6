"""Values kept between runs in the user's cache folder, such as the progress in lessons."""

import contextlib
import json
import os
from pathlib import Path
from typing import Any

import platformdirs

import msph


def file() -> Path:
    """Returns the cache file of this version."""
    return platformdirs.user_cache_path("msph") / f"measured-{msph.__version__}.json"


def _read() -> dict[str, Any]:
    try:
        found = json.loads(file().read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


def recall(key: str, default: Any = None) -> Any:
    """Returns the value stored under a key, or the default."""
    return _read().get(key, default)


def remember(key: str, value: Any) -> None:
    """Stores a value under a key, if the cache is writable."""
    with contextlib.suppress(OSError):
        file().parent.mkdir(parents=True, exist_ok=True)
        # A temporary file per process: concurrent runs must not read or write a partial file.
        part = file().with_suffix(f".{os.getpid()}.part")
        part.write_text(json.dumps(_read() | {key: value}, indent=1) + "\n", encoding="utf-8")
        part.replace(file())
