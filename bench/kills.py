"""Kills one of the two processes of `play` and `capture` at random times: does the other one end,
and is everything kept?

    xvfb-run python bench/kills.py 100 [SEED]

Prints a row for each kill, and the number of failures: processes that remain after GRACE, names of
shared memory, recordings that cannot be read, videos that do not play, and lost autosaves. Without
a display only captures run.
"""

import contextlib
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import psutil
from imageio_ffmpeg import count_frames_and_secs

from msph.stage import autosave
from msph.stage.recorded_input import RecordingError, read

ROOT, MEMORY = Path(__file__).parents[1], Path("/dev/shm")
# Longest times [s] until both processes have ended, and until a start is complete.
GRACE, PATIENCE = 15.0, 300.0
# Longest random time [s] after the start, or after both processes are ready: in a third of it an
# autosave is due.
LATEST = 3.0 * autosave.INTERVAL
SIZE = "320x180"


def names() -> set[str]:
    """Returns the names of shared memory."""
    return {path.name for path in MEMORY.iterdir()} if MEMORY.is_dir() else set()


def in_use(name: str) -> bool:
    """Returns True if a process, here of another program, has mapped shared memory."""
    for maps in Path("/proc").glob("[0-9]*/maps"):
        with contextlib.suppress(OSError):
            if name in maps.read_text():
                return True
    return False


def wait_until(condition, seconds: float) -> bool:
    """Waits until a condition holds; returns False after a time [s]."""
    end = time.monotonic() + seconds
    while not condition() and time.monotonic() < end:
        time.sleep(0.05)
    return bool(condition())


def killed(command: str, folder: Path) -> tuple[str, list[str]]:
    """Starts a command, kills one of its processes, and returns a description and the failures."""
    before, log, recorded, video = names(), folder / "log", folder / "r.jsonl", folder / "v.mp4"
    more = ["--record-input", str(recorded), "--quality", "small"]
    if command == "capture":
        more = ["-o", str(video), "--seconds", "1000"]
    process = subprocess.Popen(
        [sys.executable, "-u", ROOT / "main.py", command, "still", "--size", SIZE, *more],
        env={**os.environ, "XDG_CACHE_HOME": str(folder)},
        cwd=folder,
        stdout=log.open("w"),
        stderr=subprocess.STDOUT,
    )
    main = psutil.Process(process.pid)
    begun = random.random() < 0.7 and wait_until(lambda: "ready in" in log.read_text(), PATIENCE)
    ready = time.monotonic()
    time.sleep(random.uniform(0.0, LATEST))
    others = main.children(recursive=True)
    found = [p for p in others if "spawn_main" in " ".join(p.cmdline())]
    target = random.choice([main, *found])
    age = time.monotonic() - ready
    target.send_signal(signal.SIGKILL)
    failures = []
    # Zombies of a killed main process are reaped here.
    if not wait_until(lambda: process.poll() is not None, GRACE):
        failures.append("the main process remains")
    left = psutil.wait_procs(others, GRACE)[1]
    failures += [f"process remains: {' '.join(p.cmdline())}" for p in left]
    failures += [f"shared memory {name}" for name in names() - before if not in_use(name)]
    lines = [line for line in log.read_text().splitlines() if line.startswith("msph: ")]
    if found and len(lines) != 1:
        failures.append(f"{len(lines)} lines")
    if begun and command == "play" and age > 1.0:
        try:
            read(recorded)
        except RecordingError as error:
            failures.append(str(error))
        if age > 2 * autosave.INTERVAL - 1.0:
            for path in folder.glob(f"**/{autosave.PREFIX}*.npz"):
                np.load(path)
                break
            else:
                failures.append("no autosave")
    if begun and command == "capture" and age > 1.0 and count_frames_and_secs(str(video))[0] < 1:
        failures.append("no video")
    which = "main" if target is main else "simulation"
    state = f"{age:.1f} s after {'ready' if begun else 'the start'}"
    return f"{command}: {which} killed {state}: {'; '.join(lines) or '-'}", failures


def main() -> None:
    number, failed = int(sys.argv[1]), 0
    commands = ("play", "capture") if os.environ.get("DISPLAY") else ("capture",)
    random.seed(int(sys.argv[2]) if len(sys.argv) > 2 else 1)
    for k in range(number):
        with tempfile.TemporaryDirectory() as folder:
            told, failures = killed(commands[k % len(commands)], Path(folder))
        failed += bool(failures)
        print(f"{k + 1}: {told}{''.join(f' FAILED: {f}' for f in failures)}", flush=True)
    print(f"{failed} of {number} kills failed")


if __name__ == "__main__":
    main()
