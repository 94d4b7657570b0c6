"""Speed of system 3 in the deep pool against its targets, with its errors.

python bench/fps.py [--seconds 5] [--repeats 3] [--arch cpu]
"""

import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import click
from tabulate import tabulate

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from bench.report import RESULTS, heading
from msph.device import ARCHES, start
from msph.scene import load_scene
from msph.stage.benchmark import Result, benchmark

SCENE, VARIANT, METHOD = "pool_2x", "variant=system-3", "method=classic"
SIZE = (640, 360)
# Targets on 2 CPU cores: simulated frames of 1/60 s per second without rendering, time of surface
# and image [ms], time from a start with cached kernels to the first frame [s].
TARGET_FPS, TARGET_DRAWING, TARGET_START = 60.0, 12.0, 5.0


def first_frame(arch: str) -> float:
    """Returns the elapsed time [s] of a process that renders one frame, with cached kernels."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "msph", "capture", SCENE, "--set", VARIANT]
        command += ["-o", f"{folder}/frame.png", "--seconds", "0.01", "--size", "640x360"]
        begin = time.perf_counter()
        subprocess.run([*command, "--arch", arch], check=True, capture_output=True)
        return time.perf_counter() - begin


def spread(values: list[float], digits: int) -> str:
    """Returns the median (minimum to maximum) of the values."""
    return f"{statistics.median(values):.{digits}f} ({min(values):.{digits}f} to " + (
        f"{max(values):.{digits}f})"
    )


@click.command()
@click.option("--seconds", default=5.0, show_default=True, help="Simulated time of each run [s].")
@click.option(
    "--repeats",
    default=3,
    show_default=True,
    type=click.IntRange(min=1),
    help="Number of runs of each scene.",
)
@click.option("--arch", type=click.Choice(ARCHES), default="auto", show_default=True)
def main(seconds: float, repeats: int, arch: str) -> None:
    """Measure the speed and write bench/results/fps.md."""
    starts = [first_frame(arch) for _ in range(repeats + 1)][1:]
    arch = start(arch)
    # Rocking turns the view, so the backdrop is redrawn in every frame; at rest it is reused.
    rocking = load_scene(SCENE, (VARIANT, METHOD))
    steady = load_scene(SCENE, (VARIANT, METHOD, "sway.angle=0"))
    names = {f"{SCENE}, steady": steady, f"{SCENE}, rocking": rocking}
    results: dict[str, list[Result]] = {name: [] for name in names}
    for _ in range(repeats):
        for name, scene in names.items():
            results[name].append(benchmark(scene, name, seconds, size=SIZE))
    rows = []
    for name, runs in results.items():
        fps = [1e3 / (r.stages_p50_ms["fluid"]) for r in runs]
        drawing = [r.stages_p50_ms["surface"] + r.stages_p50_ms["picture"] for r in runs]
        mean = [r.fluid_frames_per_second for r in runs]
        rows.append((f"{name}: fluid only, frames/s", f">= {TARGET_FPS:g}", spread(fps, 1)))
        rows.append((f"{name}: mean of the run, frames/s", f">= {TARGET_FPS:g}", spread(mean, 1)))
        rows.append(
            (f"{name}: surface and image, ms", f"<= {TARGET_DRAWING:g}", spread(drawing, 1))
        )
    rows.append(
        ("start with cached kernels to first frame, s", f"<= {TARGET_START:g}", spread(starts, 1))
    )
    text = [
        heading("Speed of system 3 in the deep pool", arch),
        f"{VARIANT}; {repeats} runs of {seconds:g} s each; frames of 1/60 s, "
        f"{SIZE[0]}x{SIZE[1]}.\nMedian over runs of the median over frames (minimum to maximum).\n",
        tabulate(rows, headers=["", "target", "measured"], tablefmt="github"),
        "\nEach run with its errors; times in milliseconds per frame:\n",
        tabulate(
            [r.row() for runs in results.values() for r in runs],
            headers="keys",
            tablefmt="github",
        ),
        "",
    ]
    RESULTS.mkdir(exist_ok=True)
    (RESULTS / "fps.md").write_text("\n".join(text))
    click.echo("\n".join(text))


if __name__ == "__main__":
    main()
