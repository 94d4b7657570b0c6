"""Time and memory over the number of particles, for uniform and for layered water.

python bench/scale.py [--most 1000000] [--frames 3] [--arch cpu]

1 m^3 of water at rest: uniform with 1,000 to 1,000,000 particles, and layered with the same finest
spacing. Every run is a separate process. Memory: of the fields of particles, neighbour list and
cells, and the peak memory of the process. If CUDA is available, all runs are repeated on the CPU,
CUDA and Vulkan; --arch selects other devices.
"""

import json
import math
import statistics
import subprocess
import sys
import time
from pathlib import Path

import click
import matplotlib
import numpy as np
import taichi as ti
from tabulate import tabulate

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from bench import tanks
from bench.report import RESULTS, heading, load
from msph.device import ARCHES, start
from msph.fluid.adaptivity.bands import AdaptationParameters, bands
from msph.fluid.external_forces import ExternalForces
from msph.fluid.particles.layers import LayerSpec
from msph.fluid.projection.solver import Projection
from msph.fluid.simulation import WORD, Simulation, footprint
from msph.measure.timings import peak_memory
from msph.scene.schema import Scene

matplotlib.use("Agg")
import matplotlib.pyplot as plt

# Edge of the cube of water [m], and numbers of particles along it.
EDGE, ALONG = 1.0, (10, 15, 22, 32, 46, 68, 100)
UNIFORM, LAYERED = "uniform", "layered"
# Largest share of the depth (-) above the coarsest layer, which must be a few particles deep.
ABOVE_COARSEST = 0.8
# Capacity over the number of particles in the bands (-), as neighbouring bands overlap.
ROOM = 1.5
# Smallest number of timed frames with layers, since not every step has a pass of adaptation.
LAYERED_FRAMES = 8
# Target of the memory per particle [bytes], neighbour list included.
TARGET_BYTES = 600
# Smallest number of particles for the fit of slopes; launches dominate the time of smaller runs.
FIT_FROM = 10_000


def specs_of(finest: float, layers: int) -> list[LayerSpec]:
    """Returns layers of mass ratio 2 with the finest spacing `finest` [m]."""
    mass = 1000.0 * finest**3
    return [LayerSpec(mass * 2**k, 1000.0, Projection.SMOOTHING) for k in range(layers)]


def layers_of(along: int) -> int:
    """Returns the largest number of layers whose bands leave room for the coarsest layer."""
    band, layers = AdaptationParameters().band, 2
    while bands(specs_of(EDGE / along, layers + 1), band)[-1][0] < ABOVE_COARSEST * EDGE:
        layers += 1
    return layers


def scene_of(kind: str, along: int) -> Scene:
    """Returns the scene of uniform water of along^3 particles, or of layers with that finest
    spacing."""
    finest = EDGE / along
    if kind == UNIFORM:
        return tanks.tank((EDGE, EDGE), EDGE, finest, 1)
    specs = specs_of(finest, layers_of(along))
    held = sum(
        EDGE**2 * (min(bottom, EDGE) - top) / spec.volume
        for spec, (top, bottom) in zip(
            specs, bands(specs, AdaptationParameters().band), strict=True
        )
    )
    capacity = math.ceil(ROOM * held)
    return tanks.tank((EDGE, EDGE), EDGE, finest, len(specs), capacity=capacity)


def run(kind: str, along: int, frames: int, arch: str) -> dict:
    """Runs a scene; returns its times and memory, see row()."""
    start(arch)
    sim = tanks.build(scene_of(kind, along))
    gravity = ExternalForces(gravity=(0.0, -tanks.GRAVITY, 0.0))
    sim.warm_up(tanks.FRAME)
    # The first steps are short.
    sim.advance(tanks.FRAME, gravity)
    walls, steps, iterations = [], sim.steps, sim.iterations
    for _ in range(max(frames, LAYERED_FRAMES) if kind == LAYERED else frames):
        ti.sync()
        begin = time.perf_counter()
        sim.advance(tanks.FRAME, gravity)
        ti.sync()
        walls.append(time.perf_counter() - begin)
    return {
        "kind": kind,
        "arch": arch,
        "fine": along**3,
        "particles": sim.particles.count,
        "layers": sim.layers.count,
        "frame": statistics.mean(walls),
        "low": min(walls),
        "high": max(walls),
        "steps": (sim.steps - steps) / len(walls),
        "iterations": (sim.iterations - iterations) / (sim.steps - steps),
        "process": peak_memory(),
        **memory(sim),
    }


def memory(sim: Simulation) -> dict:
    """Returns the bytes per particle of the capacity, by purpose, and the entries of the neighbour
    list per particle, allocated and used."""
    capacity, parameters = sim.particles.capacity, sim.solver.parameters
    words = footprint(sim.size, sim.layers.specs, capacity, parameters)
    neighbours, live = sim.solver.neighbours, sim.particles.count
    begin, end = (f.to_numpy()[:live] for f in (neighbours.start, neighbours.end))
    return {
        "bytes": {purpose: WORD * n / capacity for purpose, n in words.items()},
        "allocated": neighbours.index.shape[0] / capacity,
        "used": float((end - begin).mean()),
    }


def in_process(kind: str, along: int, frames: int, arch: str) -> dict | None:
    """Runs run() in a separate process; prints a message and returns None if it fails."""
    worker = json.dumps((kind, along, frames, arch))
    command = [sys.executable, __file__, "--worker", worker]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        why = done.stderr.strip().splitlines()[-1:] or [f"exit status {done.returncode}"]
        click.echo(f"{kind}, {along**3:,}, {arch}: skipped, {why[0]}")
        return None
    return json.loads(done.stdout.strip().splitlines()[-1])


def starts(arch: str) -> bool:
    """Returns True if this machine has the device `arch`."""
    code = f"from msph.device import start; start({arch!r})"
    root = Path(__file__).resolve().parent.parent
    return not subprocess.run(
        [sys.executable, "-c", code], cwd=root, capture_output=True
    ).returncode


def row(found: dict) -> dict[str, str]:
    """Returns the table row of a run."""
    step = found["frame"] / found["steps"]
    parts = found["bytes"]
    return {
        "arch": found["arch"],
        "water": found["kind"],
        "fine-equivalent": f"{found['fine']:,}",
        "particles": f"{found['particles']:,}",
        "layers": f"{found['layers']}",
        "ms per frame": f"{1e3 * found['frame']:.3g} "
        f"({1e3 * found['low']:.3g} to {1e3 * found['high']:.3g})",
        "steps per frame": f"{found['steps']:.1f}",
        "iterations per step": f"{found['iterations']:.1f}",
        "us per particle and frame": f"{1e6 * found['frame'] / found['particles']:.2f}",
        "us per particle and step": f"{1e6 * step / found['particles']:.2f}",
        "bytes per particle": f"{sum(parts.values()):,.0f}",
        "attributes": f"{parts['particles']:,.0f}",
        "neighbour list": f"{parts['neighbours']:,.0f}",
        "cells": f"{parts['cells']:,.0f}",
        "entries allocated / used": f"{found['allocated']:.0f} / {found['used']:.0f}",
        "process MiB": f"{found['process'] / 2**20:,.0f}",
    }


def slope(x: list[float], y: list[float]) -> float:
    """Returns the exponent (-) of the power law fitted to points with x >= FIT_FROM, or to all if
    there are fewer than two such points."""
    large = [(a, b) for a, b in zip(x, y, strict=True) if a >= FIT_FROM]
    points = large if len(large) > 1 else list(zip(x, y, strict=True))
    return float(np.polyfit(*np.log(np.array(points)).T, 1)[0]) if len(points) > 1 else math.nan


# Quantities of the figure and the table of slopes: title, and function of a run.
QUANTITIES = {
    "ms per frame": lambda f: 1e3 * f["frame"],
    "us per particle and step": lambda f: 1e6 * f["frame"] / f["steps"] / f["particles"],
    "bytes per particle": lambda f: sum(f["bytes"].values()),
    "process MiB": lambda f: f["process"] / 2**20,
}


def series(found: list[dict]) -> dict[str, list[dict]]:
    """Returns the runs by kind of water and device."""
    names = dict.fromkeys(f"{f['kind']}, {f['arch']}" for f in found)
    return {n: [f for f in found if f"{f['kind']}, {f['arch']}" == n] for n in names}


def slopes(found: list[dict]) -> list[dict[str, str]]:
    """Returns the exponents over the fine-equivalent number of particles, by series and
    quantity."""
    rows = []
    for name, runs in series(found).items():
        x = [f["fine"] for f in runs]
        exponents = {q: slope(x, [value(f) for f in runs]) for q, value in QUANTITIES.items()}
        rows.append({"water": name} | {q: f"{e:.2f}" for q, e in exponents.items()})
    return rows


def draw(found: list[dict], path: Path) -> None:
    """Draws each quantity over the fine-equivalent number of particles, both logarithmic."""
    figure, axes = plt.subplots(2, 2, figsize=(10, 8), layout="constrained")
    for ax, (quantity, value) in zip(axes.flat, QUANTITIES.items(), strict=True):
        for name, runs in series(found).items():
            x, y = [f["fine"] for f in runs], [value(f) for f in runs]
            ax.loglog(x, y, "o-", label=f"{name}: slope {slope(x, y):.2f}")
        if quantity == "bytes per particle":
            ax.axhline(TARGET_BYTES, color="0.5", linestyle="--", label=f"target {TARGET_BYTES}")
        ax.set_xlabel("fine-equivalent particles")
        ax.set_ylabel(quantity)
        ax.grid(True, which="both", alpha=0.3)
        ax.legend(fontsize="small")
    figure.savefig(path, dpi=120)
    plt.close(figure)


def text_of(found: list[dict], frames: int, note: str, arches: str) -> str:
    """Returns the report."""
    options = {"headers": "keys", "tablefmt": "github", "disable_numparse": True}
    return "\n".join(
        [
            heading("Cost and memory by the number of particles", arches) + note,
            f"{EDGE:g} m^3 of water at rest; {frames} frames of 1/60 s, at least {LAYERED_FRAMES} "
            "with layers, without the first frame: mean (minimum to maximum). Fine-equivalent: "
            "number of particles of the finest layer that would fill the volume. Bytes: of the "
            "fields of particles, neighbour list and cells, per particle of the capacity; an entry "
            f"of the list takes {WORD * (1 + Projection.PER_ENTRY)}. Target: {TARGET_BYTES} bytes "
            "per particle. Process: peak memory on the host.\n",
            tabulate([row(f) for f in found], **options),
            f"\nExponents over the fine-equivalent number, from {FIT_FROM:,} particles:\n",
            tabulate(slopes(found), **options),
            "\n![Cost and memory](scale.png)\n",
        ]
    )


@click.command()
@click.option(
    "--most",
    default=ALONG[-1] ** 3,
    show_default=True,
    help="Largest fine-equivalent number of particles.",
)
@click.option(
    "--frames",
    default=3,
    show_default=True,
    type=click.IntRange(min=1),
    help="Number of timed frames.",
)
@click.option(
    "--arch",
    "arches",
    multiple=True,
    type=click.Choice(ARCHES[1:]),
    help="Device. Repeatable.  [default: cpu, and cuda and vulkan if CUDA is available]",
)
@click.option(
    "--worker", hidden=True, help="Kind of water, size, frames and device as JSON: one run."
)
def main(most: int, frames: int, arches: tuple[str, ...], worker: str | None) -> None:
    """Measure time and memory, and write bench/results/scale.{md,png}."""
    if worker is not None:
        click.echo(json.dumps(run(*json.loads(worker))))
        return
    note = load()
    if not arches:
        accelerated = starts("cuda")
        arches = ("cpu", "cuda", "vulkan") if accelerated else ("cpu",)
        if not accelerated:
            note += "CUDA is not available: CPU only.\n"
    found: list[dict] = []
    for along in (n for n in ALONG if n**3 <= most):
        for arch in arches:
            for kind in (UNIFORM, LAYERED):
                result = in_process(kind, along, frames, arch)
                if result:
                    found.append(result)
                    click.echo(" | ".join(row(result).values()))
                    text = text_of(found, frames, note, ", ".join(arches))
                    (RESULTS / "scale.md").write_text(text)
                    draw(found, RESULTS / "scale.png")


if __name__ == "__main__":
    main()
