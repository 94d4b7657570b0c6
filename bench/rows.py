"""Rows of a table, each measured in a process of its own and kept as soon as it is."""

import csv
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

# Letters of a failure that a table holds.
LONGEST = 200


def in_process(script: str, task: dict[str, Any], seconds: float) -> dict[str, Any]:
    """What `script --worker TASK` prints last, as JSON; of a run that fails, or takes longer than
    `seconds`, why, as "failure"."""
    command = [sys.executable, str(Path(script).resolve()), "--worker", json.dumps(task)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=seconds)
    except subprocess.TimeoutExpired:
        return {"failure": f"longer than {seconds:g} s"}
    lines = (done.stdout if done.returncode == 0 else done.stderr).strip().splitlines()
    last = lines[-1] if lines else f"exit status {done.returncode}"
    return json.loads(last) if done.returncode == 0 else {"failure": last[:LONGEST]}


def read(path: Path) -> list[dict[str, str]]:
    """Rows of a table; none where there is no file."""
    if not path.exists():
        return []
    with open(path, newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def write(path: Path, rows: list[dict]) -> None:
    """Writes them beside and renames, so that a run that is stopped keeps what it had."""
    heads = list(dict.fromkeys(k for row in rows for k in row))
    beside = path.with_suffix(".part")
    with open(beside, "w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, heads)
        writer.writeheader()
        writer.writerows(rows)
    beside.replace(path)
