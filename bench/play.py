"""Speed of `play` on this machine: its start, and every shipped scene in real time.

python bench/play.py [--seconds 8] [--quality auto] [--arch cpu]

Each scene runs headless in a separate process as `play` would run it, at the default window size;
an earlier start of the scene has cached the kernels. Starts are timed with an empty kernel cache
and with a full one.
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
    """Returns the row of `bench --play` for a scene. cache: folder of the kernel cache."""
    environment = {**os.environ, **({"TI_OFFLINE_CACHE_FILE_PATH": cache} if cache else {})}
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "row.json"
        command = [sys.executable, "-m", "msph", "bench", scene, "--play", "--arch", arch]
        command += ["--seconds", str(seconds), "--quality", quality, "--json", str(file)]
        subprocess.run(command, check=True, capture_output=True, env=environment)
        return json.loads(file.read_text())[0]


def help_time() -> float:
    """Returns the shortest elapsed time [s] of five runs of `msph --help`."""
    best = float("inf")
    for _ in range(5):
        begin = time.perf_counter()
        subprocess.run([sys.executable, "-m", "msph", "--help"], check=True, capture_output=True)
        best = min(best, time.perf_counter() - begin)
    return best


def starts(arch: str) -> str:
    """Returns the elapsed times of --help and of the start of the default scene, in words."""
    with tempfile.TemporaryDirectory() as cache:
        cold = played(DEFAULT_SCENE, 0.1, "large", arch, cache)["start_seconds"]
        warm = [played(DEFAULT_SCENE, 0.1, "large", arch, cache)["start_seconds"] for _ in "123"]
    return (
        f"`msph --help` takes {help_time():.2f} s. From the start of the process until "
        f"`{DEFAULT_SCENE}` is ready\nfor its first frame: {cold:.1f} s with an empty kernel "
        f"cache, {sorted(warm)[1]:.1f} s with a full one (median of three)."
    )


@click.command()
@click.option("--seconds", default=8.0, show_default=True, help="Elapsed time of each scene [s].")
@click.option("--quality", default="auto", show_default=True, help="As for `msph play`.")
@click.option("--arch", type=click.Choice(ARCHES), default="auto", show_default=True)
def main(seconds: float, quality: str, arch: str) -> None:
    """Play every scene and write bench/results/play.md."""
    arch = start(arch)
    begin, rows = starts(arch), []
    for scene in tqdm(shipped_scenes(), unit="scene"):
        played(scene, 0.1, quality, arch)  # fills the kernel cache
        rows.append(PlayResult(**played(scene, seconds, quality, arch)).row())
    report = [
        heading("Playing the shipped scenes", arch),
        begin,
        f"\n{seconds:g} s of elapsed time each, image 960x540, quality {quality}.\n",
        tabulate(rows, headers="keys", tablefmt="github", disable_numparse=True),
        "",
    ]
    (RESULTS / "play.md").write_text("\n".join(report))
    click.echo("\n".join(report))


if __name__ == "__main__":
    main()
