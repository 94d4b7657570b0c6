"""Check of the user's cache folder before Taichi starts.

Taichi 1.7.4 ends with a segmentation fault where it cannot write its cache of compiled kernels, and
aborts where neither HOME nor XDG_CACHE_HOME is set.
"""

import atexit
import os
import shutil
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

# Environment variable of Taichi for the folder of its cache.
TAICHI_FOLDER = "TI_OFFLINE_CACHE_FILE_PATH"


def ensure(report: Callable[[str], None] | None = None) -> None:
    """Replaces a cache folder that is not writable by a temporary folder, which is removed at exit
    (XDG_CACHE_HOME), and calls `report` with one line about the problem."""
    if sys.platform == "win32":
        return
    folder = _folder()
    problem = "neither HOME nor XDG_CACHE_HOME is set"
    if folder:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=folder):
                return
        except OSError as error:
            problem = f"{folder}: {(error.strerror or 'cannot be written').lower()}"
    os.environ.pop(TAICHI_FOLDER, None)
    temporary = tempfile.mkdtemp(prefix="msph_")
    atexit.register(shutil.rmtree, temporary, ignore_errors=True)
    os.environ["XDG_CACHE_HOME"] = temporary
    if report:
        report(f"{problem}: compiled kernels and progress in lessons are not kept")


def _folder() -> Path | None:
    """Returns the folder in which Taichi keeps its cache, None where the environment names none."""
    if os.environ.get(TAICHI_FOLDER):
        return Path(os.environ[TAICHI_FOLDER])
    given, home = os.environ.get("XDG_CACHE_HOME"), os.environ.get("HOME")
    if not given and not home:
        return None
    return (Path(given) if given else Path(str(home)) / ".cache") / "taichi"
