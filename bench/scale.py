"""Cost and memory by the number of particles: uniform water, and layered water that replaces it.

python bench/scale.py [--most 1000000] [--frames 3] [--arch cpu]

A cubic metre of water at rest, finer and finer: uniform from 1,000 to 1,000,000 particles, and as
pools of layers whose finest are as fine. Every run is a process of its own. Memory is what the
fields of particles, neighbour list and cells take, and the most that the process had. Where CUDA
starts, everything is measured on the CPU, CUDA and Vulkan; --arch, repeatable, says otherwise.
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

# Edge of the water [m], and particles along it: 1,000 to 1,000,000 in all, two sizes a decade.
EDGE, ALONG = 1.0, (10, 15, 22, 32, 46, 68, 100)
UNIFORM, LAYERED = "uniform", "layered"
# Share of the depth (-) above the coarsest layer, at most: it must be the bulk of the water, and
# a few of its particles deep.
ABOVE_COARSEST = 0.8
# Room for particles over those that the bands hold (-): splits overshoot, and bands overlap.
ROOM = 1.5
# Frames that a pool of layers is timed for, at least: adaptation passes come every few steps.
LAYERED_FRAMES = 8
# Target [bytes a particle], its neighbour list included.
TARGET_BYTES = 600
# Particles from which slopes are fitted: smaller runs are mostly launches of kernels.
FIT_FROM = 10_000


def specs_of(finest: float, layers: int) -> list[LayerSpec]:
    """Layers from `finest` [m] on, each of twice the mass of the next finer."""
    mass = 1000.0 * finest**3
    return [LayerSpec(mass * 2**k, 1000.0, Projection.SMOOTHING) for k in range(layers)]


def layers_of(along: int) -> int:
    """The most layers whose bands leave room for the coarsest."""
    band, layers = AdaptationParameters().band, 2
    while bands(specs_of(EDGE / along, layers + 1), band)[-1][0] < ABOVE_COARSEST * EDGE:
        layers += 1
    return layers


def scene_of(kind: str, along: int) -> Scene:
    """Uniform water of along^3 particles, or the pool of layers whose finest are as fine."""
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
    """Times and memory of one run; see row()."""
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
    """Bytes per particle there is room for, by purpose, and entries of the neighbour list per
    particle, provided and used."""
    capacity, parameters = sim.particles.capacity, sim.solver.parameters
    words = footprint(sim.size, sim.layers.specs, capacity, parameters)
    neighbours, live = sim.solver.neighbours, sim.particles.count
    begin, end = (f.to_numpy()[:live] for f in (neighbours.start, neighbours.end))
    return {
        "bytes": {purpose: WORD * n / capacity for purpose, n in words.items()},
        "provided": neighbours.index.shape[0] / capacity,
        "used": float((end - begin).mean()),
    }


def in_process(kind: str, along: int, frames: int, arch: str) -> dict | None:
    """The same in a process of its own; None, and a line that says so, where it fails."""
    worker = json.dumps((kind, along, frames, arch))
    command = [sys.executable, __file__, "--worker", worker]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        why = done.stderr.strip().splitlines()[-1:] or [f"exit status {done.returncode}"]
        click.echo(f"{kind}, {along**3:,}, {arch}: skipped, {why[0]}")
        return None
    return json.loads(done.stdout.strip().splitlines()[-1])


def starts(arch: str) -> bool:
    """Whether this machine has such an architecture."""
    code = f"from msph.device import start; start({arch!r})"
    root = Path(__file__).resolve().parent.parent
    return not subprocess.run(
        [sys.executable, "-c", code], cwd=root, capture_output=True
    ).returncode


def row(found: dict) -> dict[str, str]:
    """A run as the table prints it."""
    step = found["frame"] / found["steps"]
    parts = found["bytes"]
    return {
        "arch": found["arch"],
        "water": found["kind"],
        "fine-equivalent": f"{found['fine']:,}",
        "particles": f"{found['particles']:,}",
        "layers": f"{found['layers']}",
        "ms a frame": f"{1e3 * found['frame']:.3g} "
        f"({1e3 * found['low']:.3g} to {1e3 * found['high']:.3g})",
        "steps a frame": f"{found['steps']:.1f}",
        "iterations a step": f"{found['iterations']:.1f}",
        "us a particle and frame": f"{1e6 * found['frame'] / found['particles']:.2f}",
        "us a particle and step": f"{1e6 * step / found['particles']:.2f}",
        "bytes a particle": f"{sum(parts.values()):,.0f}",
        "attributes": f"{parts['particles']:,.0f}",
        "neighbour list": f"{parts['neighbours']:,.0f}",
        "cells": f"{parts['cells']:,.0f}",
        "entries provided / used": f"{found['provided']:.0f} / {found['used']:.0f}",
        "process MiB": f"{found['process'] / 2**20:,.0f}",
    }


def slope(x: list[float], y: list[float]) -> float:
    """Exponent (-) of the power law through the points from FIT_FROM on, or all if they are few."""
    large = [(a, b) for a, b in zip(x, y, strict=True) if a >= FIT_FROM]
    points = large if len(large) > 1 else list(zip(x, y, strict=True))
    return float(np.polyfit(*np.log(np.array(points)).T, 1)[0]) if len(points) > 1 else math.nan


# Quantities of the figure and the table of slopes: title, and value of a run.
QUANTITIES = {
    "ms a frame": lambda f: 1e3 * f["frame"],
    "us a particle and step": lambda f: 1e6 * f["frame"] / f["steps"] / f["particles"],
    "bytes a particle": lambda f: sum(f["bytes"].values()),
    "process MiB": lambda f: f["process"] / 2**20,
}


def series(found: list[dict]) -> dict[str, list[dict]]:
    """Runs by water and architecture."""
    names = dict.fromkeys(f"{f['kind']}, {f['arch']}" for f in found)
    return {n: [f for f in found if f"{f['kind']}, {f['arch']}" == n] for n in names}


def slopes(found: list[dict]) -> list[dict[str, str]]:
    """Exponents over the fine-equivalent number, by series and quantity."""
    rows = []
    for name, runs in series(found).items():
        x = [f["fine"] for f in runs]
        exponents = {q: slope(x, [value(f) for f in runs]) for q, value in QUANTITIES.items()}
        rows.append({"water": name} | {q: f"{e:.2f}" for q, e in exponents.items()})
    return rows


def draw(found: list[dict], path: Path) -> None:
    """The figure: each quantity over the fine-equivalent number, both logarithmic."""
    figure, axes = plt.subplots(2, 2, figsize=(10, 8), layout="constrained")
    for ax, (quantity, value) in zip(axes.flat, QUANTITIES.items(), strict=True):
        for name, runs in series(found).items():
            x, y = [f["fine"] for f in runs], [value(f) for f in runs]
            ax.loglog(x, y, "o-", label=f"{name}: slope {slope(x, y):.2f}")
        if quantity == "bytes a particle":
            ax.axhline(TARGET_BYTES, color="0.5", linestyle="--", label=f"target {TARGET_BYTES}")
        ax.set_xlabel("fine-equivalent particles")
        ax.set_ylabel(quantity)
        ax.grid(True, which="both", alpha=0.3)
        ax.legend(fontsize="small")
    figure.savefig(path, dpi=120)
    plt.close(figure)


def text_of(found: list[dict], frames: int, note: str, arches: str) -> str:
    """The report."""
    options = {"headers": "keys", "tablefmt": "github", "disable_numparse": True}
    return "\n".join(
        [
            heading("Cost and memory by the number of particles", arches) + note,
            f"{EDGE:g} m^3 of water at rest; {frames} frames of 1/60 s, {LAYERED_FRAMES} or more "
            "in layers, the first steps left out: mean (lowest to highest). Fine-equivalent: "
            "particles of the finest layer that would fill it. Bytes: of the fields of particles, "
            "neighbour list and cells, for each particle there is room for; an entry of the list "
            f"takes {WORD * (1 + Projection.PER_ENTRY)}. Target: {TARGET_BYTES} bytes a particle. "
            f"Process: its largest resident size, on the host.\n",
            tabulate([row(f) for f in found], **options),
            f"\nSlopes over the fine-equivalent number, from {FIT_FROM:,} on:\n",
            tabulate(slopes(found), **options),
            "\n![Cost and memory](scale.png)\n",
        ]
    )


@click.command()
@click.option(
    "--most", default=ALONG[-1] ** 3, show_default=True, help="Fine-equivalent particles."
)
@click.option("--frames", default=3, show_default=True, type=click.IntRange(min=1))
@click.option(
    "--arch", "arches", multiple=True, type=click.Choice(ARCHES[1:]), help="[default: see above]"
)
@click.option("--worker", hidden=True, help="Water, size, frames and arch as JSON: one run.")
def main(most: int, frames: int, arches: tuple[str, ...], worker: str | None) -> None:
    """Measure and write bench/results/scale.{md,png}."""
    if worker is not None:
        click.echo(json.dumps(run(*json.loads(worker))))
        return
    note = load()
    if not arches:
        accelerated = starts("cuda")
        arches = ("cpu", "cuda", "vulkan") if accelerated else ("cpu",)
        if not accelerated:
            note += "No accelerator at hand (CUDA does not start): CPU alone.\n"
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
