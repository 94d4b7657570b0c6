"""Heading of a report: title, machine, date, command and load."""

import datetime
import os
import platform
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


def load() -> str:
    """Returns the machine's load average as Markdown; call it before measuring."""
    if not hasattr(os, "getloadavg"):
        return ""
    return f"\nLoad average of the minute before the start: {os.getloadavg()[0]:.1f}.\n"
