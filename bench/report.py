"""Folder of the results; machine, versions and date of a measurement."""

import datetime
import os
import platform
import subprocess
from pathlib import Path

from msph.measure.machine import machine

RESULTS = Path(__file__).parent / "results"


def place(arch: str, threads: int | None) -> str:
    """Returns machine, device, threads, versions and date of a measurement, in words."""
    words = [machine(), f"arch {arch}", f"threads: {threads or os.cpu_count()}"]
    words += [f"Python {platform.python_version()}", f"version {version()}"]
    return "; ".join([*words, datetime.date.today().isoformat()])


def version() -> str:
    """Returns the commit of this checkout, "unknown" without Git."""
    command = ["git", "-C", str(RESULTS), "describe", "--always", "--dirty"]
    try:
        return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
