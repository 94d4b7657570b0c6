"""Rows of a table, each measured in a separate process and saved when it ends, and their machine,
versions and date."""

import csv
import datetime
import json
import os
import platform
import statistics
import subprocess
import sys
from pathlib import Path
from typing import Any

from msph.measure.machine import machine

RESULTS = Path(__file__).parent / "results"
# Number of starts of each row: initial arrangements with different random displacements.
STARTS = 3
# Largest number of characters of a failure message.
MAX_CHARACTERS = 200


def in_process(script: str, task: Any, seconds: float) -> dict[str, Any]:
    """Runs `script --worker TASK`; returns its last line, read as JSON, or {"failure": message} if
    it fails or takes longer than `seconds`."""
    command = [sys.executable, str(Path(script).resolve()), "--worker", json.dumps(task)]
    try:
        done = subprocess.run(command, timeout=seconds, capture_output=True, text=True)
    except subprocess.TimeoutExpired:
        return {"failure": f"longer than {seconds:g} s"}
    lines = (done.stdout if done.returncode == 0 else done.stderr).strip().splitlines()
    last = lines[-1] if lines else f"exit status {done.returncode}"
    return json.loads(last) if done.returncode == 0 else {"failure": last[:MAX_CHARACTERS]}


def read(path: Path) -> list[dict[str, str]]:
    """Returns the rows of a CSV file without empty cells; an empty list if there is no file."""
    if not path.exists():
        return []
    with open(path, newline="", encoding="utf-8") as file:
        return [{k: v for k, v in row.items() if v} for row in csv.DictReader(file)]


def write(path: Path, rows: list[dict]) -> None:
    """Writes rows to a temporary file and renames it, so that an interrupted run loses no rows."""
    heads = list(dict.fromkeys(k for row in rows for k in row))
    temporary = path.with_suffix(".part")
    with open(temporary, "w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, heads)
        writer.writeheader()
        writer.writerows(rows)
    temporary.replace(path)


def spread(values: list[float], form: str) -> str:
    """Returns the median (least to largest) of the values in a format, such as ".1%"."""
    numbers = statistics.median(values), min(values), max(values)
    middle, least, most = (format(v, form).replace("%", " %") for v in numbers)
    return middle if least == most else f"{middle} ({least} to {most})"


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
