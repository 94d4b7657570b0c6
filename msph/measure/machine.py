"""Description of this machine, printed with every measured speed."""

import platform
from pathlib import Path

import psutil


def machine() -> str:
    """Returns the processor, number of cores, memory and system of this machine in words."""
    model = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.exists():
        lines = [x for x in info.read_text().splitlines() if x.startswith("model name")]
        model = lines[0].split(":")[1].strip() if lines else model
    gib = psutil.virtual_memory().total / 2**30
    return f"{psutil.cpu_count()} cores of {model}, {gib:.0f} GiB, {platform.system()}"
