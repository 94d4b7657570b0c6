"""What every report says of itself: where and when it was measured, and by which command."""

import datetime
import platform
import sys
from pathlib import Path

import psutil

RESULTS = Path(__file__).parent / "results"


def machine() -> str:
    """Processor, cores and memory of this machine, in words."""
    model = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.exists():
        lines = [x for x in info.read_text().splitlines() if x.startswith("model name")]
        model = lines[0].split(":")[1].strip() if lines else model
    gib = psutil.virtual_memory().total / 2**30
    return f"{psutil.cpu_count()} cores of {model}, {gib:.0f} GiB, {platform.system()}"


def heading(title: str, arch: str) -> str:
    """Title, machine, date and command of a report, as Markdown."""
    today = datetime.date.today().isoformat()
    command = " ".join(["python", *sys.argv])
    python = platform.python_version()
    return f"# {title}\n\n{machine()}; arch {arch}, Python {python}; {today}; `{command}`\n"
