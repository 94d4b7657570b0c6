"""What `play` is like on this machine: its start, and every shipped scene by the wall clock.

python bench/play.py [--seconds 8] [--quality auto] [--arch cpu]

Each scene is played without a window in a process of its own, by the clock of the window, at the
window's default size; kernels are cached by an earlier start of the same scene. Starts are timed
with an empty cache of kernels and with a full one.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import click
from tabulate import tabulate
from tqdm import tqdm

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from bench.report import RESULTS, heading
from msph import DEFAULT_SCENE
from msph.device import ARCHES, start
from msph.scene.library import shipped_scenes
from msph.stage.benchmark import PlayResult


def played(scene: str, seconds: float, quality: str, arch: str, cache: str = "") -> dict:
    """What `bench --play` says of a scene; cache: a folder for compiled kernels of its own."""
    environment = {**os.environ, **({"TI_OFFLINE_CACHE_FILE_PATH": cache} if cache else {})}
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "row.json"
        command = [sys.executable, "-m", "msph", "bench", scene, "--play", "--arch", arch]
        command += ["--seconds", str(seconds), "--quality", quality, "--json", str(file)]
        subprocess.run(command, check=True, capture_output=True, env=environment)
        return json.loads(file.read_text())[0]


def help_time() -> float:
    """Wall-clock time [s] of `msph --help`, the fastest of five."""
    best = float("inf")
    for _ in range(5):
        begin = time.perf_counter()
        subprocess.run([sys.executable, "-m", "msph", "--help"], check=True, capture_output=True)
        best = min(best, time.perf_counter() - begin)
    return best


def starts(arch: str) -> str:
    """How long help and the first frame of the default scene take, in words."""
    with tempfile.TemporaryDirectory() as cache:
        cold = played(DEFAULT_SCENE, 0.1, "large", arch, cache)["start_seconds"]
        warm = [played(DEFAULT_SCENE, 0.1, "large", arch, cache)["start_seconds"] for _ in "123"]
    return (
        f"`msph --help` takes {help_time():.2f} s. From the start of the process until "
        f"`{DEFAULT_SCENE}` is ready\nfor its first frame: {cold:.1f} s with an empty cache of "
        f"kernels, {sorted(warm)[1]:.1f} s with a full one (median of three)."
    )


@click.command()
@click.option("--seconds", default=8.0, show_default=True, help="Wall-clock time of each scene.")
@click.option("--quality", default="auto", show_default=True)
@click.option("--arch", type=click.Choice(ARCHES), default="auto", show_default=True)
def main(seconds: float, quality: str, arch: str) -> None:
    """Play all and write bench/results/play.md."""
    arch = start(arch)
    begin, rows = starts(arch), []
    for scene in tqdm(shipped_scenes(), unit="scene"):
        played(scene, 0.1, quality, arch)  # fills the cache of kernels
        rows.append(PlayResult(**played(scene, seconds, quality, arch)).row())
    report = [
        heading("Playing the shipped scenes", arch),
        begin,
        f"\n{seconds:g} s of each by the wall clock, picture 960x540, quality {quality}.\n",
        tabulate(rows, headers="keys", tablefmt="github", disable_numparse=True),
        "",
    ]
    (RESULTS / "play.md").write_text("\n".join(report))
    click.echo("\n".join(report))


if __name__ == "__main__":
    main()
