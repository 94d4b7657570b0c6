"""What every report says of itself: where and when it was measured, and by which command."""

import datetime
import os
import platform
import sys
from pathlib import Path

from msph.measure.machine import machine

RESULTS = Path(__file__).parent / "results"


def heading(title: str, arch: str) -> str:
    """Title, machine, date and command of a report, as Markdown."""
    today = datetime.date.today().isoformat()
    command = " ".join(["python", *sys.argv])
    python = platform.python_version()
    return f"# {title}\n\n{machine()}; arch {arch}, Python {python}; {today}; `{command}`\n"


def load() -> str:
    """The machine's load by others, for reports of speed, as Markdown; read before measuring."""
    if not hasattr(os, "getloadavg"):
        return ""
    return f"\nProcesses that wanted a core in the minute before: {os.getloadavg()[0]:.1f}.\n"
