"""Numerical friction: decay of low waves and drag of a slowly towed ball, without and with shear
relief, in uniform and layered water.

python bench/friction.py [--starts 3] [--only waves] [--resume] [--arch cpu]

Starts differ in the random initial displacements of the particles, 0.02 spacings. Every row runs in
a separate process and is written to bench/results/friction.csv when it ends; --resume continues
there. Decrements and forces are computed from positions and from the impulse on the body.
"""

import json
import math
import sys
from pathlib import Path
from typing import Any

import click
import numpy as np
from tabulate import tabulate
from tqdm import tqdm

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from bench import rows, tanks
from bench.report import RESULTS, heading
from msph.device import ARCHES, start
from msph.scene.schema import Scene

TABLE, REPORT = "friction.csv", "friction.md"
# Length, width and depth of the tank of the waves [m]; time at rest before the wave [s]; periods.
LENGTH, WIDTH, DEPTH, SETTLE, PERIODS = 0.9, 0.3, 0.3, 1.0, 4
# Depth in finest spacings and amplitude over depth.
WAVES = ((8, 0.03), (8, 0.1), (12, 0.03), (12, 0.1), (20, 0.03))
# Number of layers of each kind of water.
WATERS = {"uniform": 1, "layered": 3}
RELIEFS = (0.0, 1.0)
# Towed ball: tank and depth [m], radius [m], start [m], speeds [m/s], spacing [m]: 3.3 spacings.
TANK, WATER, RADIUS, FROM, SPEEDS, SPACING = (1.8, 0.7, 0.6), 0.5, 0.1, 0.3, (0.5, 1.0), 0.03
# Distances between which the force is measured [m]: after the start, before the far wall.
MEASURED = (0.4, 0.9)
MAX_SECONDS = 3600.0


def relieved(scene: Scene, relief: float) -> Scene:
    """Returns the scene with a share of shear relief (-)."""
    terms = scene.projection.model_copy(update={"shear_relief": relief})
    return scene.model_copy(update={"projection": terms})


def wave(layers: int, relief: float, seed: int, spacings: int, amplitude: float) -> dict[str, Any]:
    """Returns the logarithmic decrement per period of the first mode (theory: 0) and the error of
    its period (-), from the centre of mass."""
    scene = tanks.tank((LENGTH, WIDTH), DEPTH, DEPTH / spacings, layers, air=0.1, seed=seed)
    sim = tanks.build(relieved(scene, relief))
    tanks.run(sim, SETTLE)
    tanks.slosh(sim, DEPTH, amplitude * DEPTH)
    theory, reading = tanks.slosh_period(LENGTH, DEPTH), tanks.Reading(sim)
    tanks.run(sim, PERIODS * theory, reading)
    rate, period = tanks.fitted_wave(
        [t - SETTLE for t in reading.times], np.array(reading.centres)[:, 0], theory
    )
    return {"particles": sim.particles.count, "value": rate * period, "period": period / theory - 1}


def tow(layers: int, relief: float, seed: int, speed: float) -> dict[str, Any]:
    """Returns the drag coefficient of a submerged ball towed at `speed` [m/s]."""
    scene = tanks.tank((TANK[0], TANK[2]), WATER, SPACING, layers, air=TANK[1] - WATER, seed=seed)
    ball = {"centre": [FROM, 0.5 * WATER, 0.5 * TANK[2]], "radius": RADIUS}
    given = scene.model_dump() | {"bodies": [ball | {"velocity": [speed, 0.0, 0.0]}]}
    sim = tanks.build(relieved(Scene.model_validate(given), relief))
    begin = end = impulse = math.nan
    while speed * sim.time < MEASURED[1]:
        tanks.run(sim, tanks.FRAME)
        end = -float(sim.boundary.impulse[0, 0])
        if math.isnan(begin) and speed * sim.time >= MEASURED[0]:
            begin, impulse = sim.time, end
    force = (end - impulse) / (sim.time - begin)
    pressure = 0.5 * 1000.0 * speed**2 * math.pi * RADIUS**2
    return {"particles": sim.particles.count, "value": force / pressure}


def tasks(starts: int, only: str) -> list[dict[str, Any]]:
    """Returns the rows to measure: case, water, relief, start and the case's own settings."""
    cases: list[dict[str, Any]] = [
        {"case": "waves", "spacings": n, "amplitude": a} for n, a in WAVES
    ] + [{"case": "towed ball", "speed": u} for u in SPEEDS]
    return [
        {**case, "water": water, "relief": relief, "start": seed}
        for case in cases
        if only in case["case"]
        for water in WATERS
        for relief in RELIEFS
        for seed in range(starts)
    ]


def measure(task: dict[str, Any]) -> dict[str, Any]:
    """Returns the figures of one row."""
    layers = WATERS[task["water"]]
    if task["case"] == "waves":
        return wave(layers, task["relief"], task["start"], task["spacings"], task["amplitude"])
    return tow(layers, task["relief"], task["start"], task["speed"])


def report(known: list[dict[str, str]], arch: str) -> str:
    """Returns the report as Markdown."""
    text = [heading("Numerical friction", arch)]
    text.append(
        "Median (range) over the starts. An ideal liquid has a decrement of 0; at Reynolds "
        "numbers of 1e5 and 2e5 a ball in water has a drag coefficient of about 0.4.\n"
    )
    for case, head in (("waves", "depth in spacings, amplitude"), ("towed ball", "speed, m/s")):
        mine = [row for row in known if row["case"] == case and row.get("value")]
        groups: dict[tuple[str, str], dict[tuple[str, str], list[dict]]] = {}
        for row in mine:
            name = row["speed"] if case != "waves" else f"{row['spacings']}, {row['amplitude']} H"
            cells = groups.setdefault((name, row["water"]), {})
            cells.setdefault(row["relief"], []).append(row)
        table = []
        for (name, water), cells in groups.items():
            line = {head: name, "water": water}
            for relief in map(str, RELIEFS):
                label = "shear relief" if float(relief) else "without relief"
                found = cells.get(relief, [])
                if found:
                    line[label] = rows.spread([float(r["value"]) for r in found], "{:.3f}")
                if found and case == "waves":
                    errors = [100.0 * float(r["period"]) for r in found]
                    line[f"period off, %, {label}"] = rows.spread(errors, "{:.2f}")
            table.append(line)
        what = (
            "Logarithmic decrement of the first mode per period"
            if case == "waves"
            else "Drag coefficient"
        )
        text += [f"## {what}\n", tabulate(table, headers="keys", tablefmt="github"), ""]
    return "\n".join(text)


@click.command()
@click.option("--starts", default=3, show_default=True, type=click.IntRange(1))
@click.option("--only", default="", help='"waves" or "towed ball".')
@click.option("--resume", is_flag=True, help="Keep the rows of friction.csv.")
@click.option("--arch", type=click.Choice(ARCHES), default="auto", show_default=True)
@click.option("--worker", hidden=True, help="Measure one row, given as JSON.")
def main(starts: int, only: str, resume: bool, arch: str, worker: str | None) -> None:
    """Measure numerical friction and write bench/results/friction.{md,csv}."""
    if worker:
        start(arch)
        click.echo(json.dumps(measure(json.loads(worker))))
        return
    known = rows.read(RESULTS / TABLE) if resume else []
    for task in tqdm(tasks(starts, only), unit="run"):
        row = {k: str(v) for k, v in task.items()}
        if any(all(old.get(k) == v for k, v in row.items()) for old in known):
            continue
        known.append(row | rows.in_process(__file__, task, MAX_SECONDS))
        rows.write(RESULTS / TABLE, known)
    text = report(rows.read(RESULTS / TABLE), start(arch))
    (RESULTS / REPORT).write_text(text, encoding="utf-8")
    click.echo(text)


if __name__ == "__main__":
    main()
