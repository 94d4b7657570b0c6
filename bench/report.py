"""Heading of a report: title, machine, date, command and load."""

import datetime
import os
import platform
import subprocess
import sys
from pathlib import Path

from msph.measure.machine import machine

RESULTS = Path(__file__).parent / "results"


def heading(title: str, arch: str) -> str:
    """Returns the title, machine, date and command of a report, as Markdown."""
    today = datetime.date.today().isoformat()
    command = " ".join(["python", *sys.argv])
    python = platform.python_version()
    return f"# {title}\n\n{machine()}; arch {arch}, Python {python}; {today}; `{command}`\n"


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


def load() -> str:
    """Returns the machine's load average as Markdown; call it before measuring."""
    if not hasattr(os, "getloadavg"):
        return ""
    return f"\nLoad average of the minute before the start: {os.getloadavg()[0]:.1f}.\n"
