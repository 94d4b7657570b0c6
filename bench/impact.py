"""Convergence of the pressures of a dam break on the far wall.

python bench/impact.py [--quick] [--arch cpu]

Incompressible water stops within a time step, so the pressure in a single step is an impulse over
the length of the step: it grows with shorter steps and falls with the spacing. The impulse
converges, and so does the mean pressure over a time in which several layers of particles arrive.
Sensors read 0 while they are dry.
"""

import math
import sys
from pathlib import Path

import click
import numpy as np
from tabulate import tabulate

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from bench.report import RESULTS, heading
from msph.device import ARCHES, start
from msph.measure.probes import PressureProbe
from msph.measure.snapshot import Snapshot
from msph.scene import load_scene
from msph.scene.schema import Scene
from msph.stage.controls import Controls
from msph.stage.show import Show

# Factors of the scene's spacings (-), and times between readings [s], which limit the time steps.
RUNS = ((1.26, 0.004), (1.0, 0.004), (0.8, 0.004), (0.63, 0.004), (1.0, 0.002), (1.0, 0.001))
QUICK = RUNS[:2]
# Simulated time [s]: until the water has climbed the far wall.
SECONDS = 1.1
# Heights of the centres of the sensors, and their edge [m]; averaging times [s].
HEIGHTS, EDGE = (0.03, 0.1, 0.2), 0.05
WINDOWS = (0.01, 0.05)


def sensors(scene: Scene) -> list[PressureProbe]:
    """Returns sensors on the far wall, one for each height."""
    wall, _, middle = np.array(scene.box.size) / 2.0 * (2.0, 1.0, 1.0)
    return [
        PressureProbe(
            f"{height} m",
            (wall, height - EDGE / 2.0, middle - EDGE / 2.0),
            (wall, height + EDGE / 2.0, middle + EDGE / 2.0),
        )
        for height in HEIGHTS
    ]


def highest_mean(readings: np.ndarray, every: float, window: float) -> float:
    """Returns the highest mean [Pa] over any `window` [s] of readings [Pa] at intervals of `every`
    [s], each of which holds since the one before."""
    impulse = np.append(0.0, readings.cumsum() * every)
    ends = every * np.arange(len(impulse))
    begins = np.maximum(ends - window, 0.0)
    return float((impulse - np.interp(begins, ends, impulse)).max() / window)


def run(factor: float, every: float) -> list[dict[str, str | float]]:
    """Returns a row for each height: highest reading and highest mean for each averaging time [Pa],
    and impulse [Pa s]."""
    scene = load_scene("dam_break")
    layers = [s.model_copy(update={"spacing": factor * s.spacing}) for s in scene.layers]
    scene = scene.model_copy(update={"layers": layers})
    show, probes = Show(scene, every, density_every=math.inf), sensors(scene)
    particles, readings = sum(show.counts), []
    while show.simulation.time < SECONDS:
        show.frame(Controls())
        water = Snapshot.of(show.simulation)
        readings.append([probe.read(water)[0] for probe in probes])
    read = np.nan_to_num(np.array(readings))
    return [
        {
            "spacing": 1e3 * layers[0].spacing,
            "particles": particles,
            "readings": every,
            "steps": show.simulation.steps,
            "height": height,
            "highest": read[:, k].max(),
            **{f"mean {w}": highest_mean(read[:, k], every, w) for w in WINDOWS},
            "impulse": read[:, k].sum() * every,
        }
        for k, height in enumerate(HEIGHTS)
    ]


def table(rows: list[dict]) -> str:
    """Returns the rows as a Markdown table."""
    named = [
        {
            "spacing, mm": f"{row['spacing']:.1f}",
            "particles": f"{row['particles']:,}",
            "time between readings, ms": f"{1e3 * row['readings']:g}",
            "steps": row["steps"],
            "height of the sensor, m": row["height"],
            "highest reading, kPa": f"{1e-3 * row['highest']:.1f}",
            **{
                f"highest mean over {1e3 * w:g} ms": f"{1e-3 * row[f'mean {w}']:.1f}"
                for w in WINDOWS
            },
            "impulse, kPa s": f"{1e-3 * row['impulse']:.2f}",
        }
        for row in sorted(rows, key=lambda r: (r["height"], -r["readings"], -r["spacing"]))
    ]
    return tabulate(named, "keys", "github", disable_numparse=True)


@click.command()
@click.option("--quick", is_flag=True, help="Run two spacings and write no file.")
@click.option("--arch", type=click.Choice(ARCHES), default="auto", show_default=True)
def main(quick: bool, arch: str) -> None:
    """Measure the pressures and write bench/results/impact.md."""
    arch = start(arch)
    rows = [row for given in (QUICK if quick else RUNS) for row in run(*given)]
    report = [
        heading("Pressures of an impact", arch),
        f"`dam_break`, {SECONDS} s; sensors of {EDGE} x {EDGE} m on the far wall.\n",
        table(rows),
        "",
    ]
    if not quick:
        (RESULTS / "impact.md").write_text("\n".join(report))
    click.echo("\n".join(report))


if __name__ == "__main__":
    main()
