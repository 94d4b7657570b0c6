"""Cost and error of each quality of every shipped scene.

python bench/quality.py [--explore] [SCENE ...] [--arch cpu]

Every run is a separate process. The error is the distance of the centre of mass from a reference
run with spacings 0.63 times the scene's, root mean square over the run, over the depth of the water
at rest. Costs are elapsed time, and CPU time of all threads, which other programs disturb less;
both per simulated second. The table is written to bench/results/quality.md, and the numbers that
`msph scenes` prints to assets/quality.json.
"""

import itertools
import json
import math
import subprocess
import sys
import time
from dataclasses import asdict
from pathlib import Path

import click
import numpy as np
from tabulate import tabulate
from tqdm import tqdm

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from bench.report import RESULTS, heading
from msph.device import ARCHES, start
from msph.scene.library import assets, shipped_scenes
from msph.scene.quality import LADDER, Quality, scaled

# Quality of the reference run.
REFERENCE = Quality(2.0 ** (-2.0 / 3.0), 0.01)
# Simulated time of a run [s], and length of its slowest part [s].
SECONDS, WINDOW = 4.0, 0.5
FRAME = 1.0 / 60.0
# Settings that --explore compares at each quality.
SMOOTHINGS, TOLERANCES = (2.0, 2.2, 2.45), (0.01, 0.03, 0.05)
# Scenes that --explore runs: a dam break, a rocking pool, a splash.
TRIED_ON = ("dam_break", "pool", "drop")


def run(name: str, quality: Quality, smoothing: float | None = None) -> dict:
    """Runs a scene; smoothing: support over spacing, None for the scene's own.

    Returns centres of mass (frames, 3) [m], energies [J], CPU and elapsed time of each frame [s],
    the largest number of particles, the depth of the water at rest [m] and its weight [N].
    """
    from msph.measure.timings import Timings
    from msph.scene import load_scene
    from msph.stage.controls import Controls
    from msph.stage.show import Show

    scene = scaled(load_scene(name), quality)
    if smoothing:
        layers = [layer.model_copy(update={"smoothing": smoothing}) for layer in scene.layers]
        scene = scene.model_copy(update={"layers": layers})
    show = Show(scene, FRAME, timings=Timings(), density_every=math.inf)
    show.warm_up()
    cpu, counts = [], []
    for _ in range(round(SECONDS / FRAME)):
        begin = time.process_time()
        show.frame(Controls())
        cpu.append(time.process_time() - begin)
        counts.append(show.simulation.particles.count)
    entries, (length, _, width) = show.ledger.entries, scene.box.size
    return {
        "centre": [e.centre.tolist() for e in entries],
        "energy": [e.energy for e in entries],
        "cpu": cpu,
        "wall": [frame["fluid"] for frame in show.timings.frames],
        "particles": max(counts),
        "height": entries[0].mass / (scene.density * length * width),
        "weight": entries[0].mass * float(np.linalg.norm(scene.gravity)),
    }


def in_process(name: str, quality: Quality, arch: str, smoothing: float | None = None) -> dict:
    """Runs run() in a separate process."""
    worker = json.dumps((name, asdict(quality), smoothing))
    command = [sys.executable, __file__, "--arch", arch, "--worker", worker]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        raise click.ClickException(f"{name}: {done.stderr.strip().splitlines()[-1]}")
    return json.loads(done.stdout.strip().splitlines()[-1])


def judged(found: dict, reference: dict) -> dict[str, float]:
    """Returns cost and error of a run: number of particles; CPU and elapsed seconds per simulated
    second, means and in the slowest half second; error against the reference (-); energy lost by
    the end over weight times depth (-)."""
    away = np.array(found["centre"]) - np.array(reference["centre"])
    window = np.ones(round(WINDOW / FRAME)) / WINDOW
    energy = found["energy"]
    return {
        "particles": found["particles"],
        "cpu": sum(found["cpu"]) / SECONDS,
        "wall": sum(found["wall"]) / SECONDS,
        "slowest": float(np.convolve(found["wall"], window, "valid").max()),
        "error": float(np.sqrt((away**2).sum(axis=1).mean())) / found["height"],
        "energy_lost": (energy[0] - energy[-1]) / (found["weight"] * found["height"]),
    }


def explore(arch: str) -> None:
    """Compares supports and tolerances at three qualities."""
    rows = []
    sizes = [LADDER[name].spacing for name in ("small", "medium", "large")]
    runs = list(itertools.product(TRIED_ON, sizes, SMOOTHINGS, TOLERANCES))
    references = {name: in_process(name, REFERENCE, arch) for name in TRIED_ON}
    for name, spacing, smoothing, tolerance in tqdm(runs, unit="run"):
        found = in_process(name, Quality(spacing, tolerance), arch, smoothing)
        row = judged(found, references[name])
        rows.append([name, f"{spacing:.3g}", smoothing, tolerance, *cells(row)])
        heads = ["scene", "spacings", "support", "tolerance", *HEADS]
        table = tabulate(rows, headers=heads, tablefmt="github", disable_numparse=True)
        title = heading("Supports and tolerances of the qualities", arch)
        (RESULTS / "quality_settings.md").write_text(f"{title}\n\n{table}\n")


HEADS = (
    "particles",
    "CPU s per s",
    "wall s per s",
    "slowest half second",
    "error %",
    "energy lost %",
)


def cells(row: dict[str, float]) -> list[str]:
    """Returns the table cells of a run."""
    shares = ("error", "energy_lost")
    return [
        f"{100 * v:.2f}" if k in shares else f"{v:,.0f}" if k == "particles" else f"{v:.3g}"
        for k, v in row.items()
    ]


@click.command()
@click.argument("scenes", nargs=-1)
@click.option(
    "--explore", "exploring", is_flag=True, help="Compare supports and tolerances instead."
)
@click.option("--worker", hidden=True, help="Scene and quality as JSON: one run, printed.")
@click.option("--arch", type=click.Choice(ARCHES), default="auto", show_default=True)
def main(scenes: tuple[str, ...], exploring: bool, worker: str | None, arch: str) -> None:
    """Measure every quality of SCENES (default: all shipped) and write bench/results/quality.md."""
    if worker is not None:
        start(arch)
        name, settings, smoothing = json.loads(worker)
        click.echo(json.dumps(run(name, Quality(**settings), smoothing)))
        return
    arch = start(arch)
    if exploring:
        explore(arch)
        return
    file = assets() / "quality.json"
    known = json.loads(file.read_text()) if file.exists() else {}
    for name in tqdm(scenes or tuple(shipped_scenes()), unit="scene"):
        reference = in_process(name, REFERENCE, arch)
        found = {q: judged(in_process(name, LADDER[q], arch), reference) for q in LADDER}
        known[name] = {q: {k: float(f"{v:.3g}") for k, v in r.items()} for q, r in found.items()}
        file.write_text(json.dumps(known, indent=1) + "\n")
    # Includes the scenes measured in earlier runs.
    rows = [[n, q, *cells(row)] for n, ladder in known.items() for q, row in ladder.items()]
    heads = ["scene", "quality", *HEADS]
    table = tabulate(rows, headers=heads, tablefmt="github", disable_numparse=True)
    (RESULTS / "quality.md").write_text(
        f"{heading('Qualities of the shipped scenes', arch)}\n\n{table}\n"
    )


if __name__ == "__main__":
    main()
