"""Bodies in water against formulas: pressure on their faces, buoyancy, drafts, and energy.

python bench/bodies.py [--only drafts] [--resume] [--arch cpu] [--threads 1]

Every row runs in a separate process and is written to bench/results/bodies.csv when it ends;
--resume continues there, and --only keeps the rows of other tables.
"""

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import click
from tabulate import tabulate
from tqdm import tqdm

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from bench import floating, rows
from bench import held_bodies as held
from bench.report import RESULTS, heading
from msph.device import ARCHES, start

TABLE, REPORT = "bodies.csv", "bodies.md"
# Columns that identify a row: its table and its settings.
KEYS = ("table", "settings")
# Longest wall-clock time of a row [s].
MAX_SECONDS = 7200.0
# Heave decays: layers, finest spacing and width of the tank [m], starts, depth [m] and shear
# relief (-).
HEAVES = [
    (5, 0.025, 1.6, 3, 0.9, 0.0),
    (5, 0.025, 1.6, 3, 0.9, 1.0),
    (7, 0.01875, 1.6, 1, 0.9, 1.0),
    (7, 0.01875, 2.6, 3, 0.9, 1.0),  # half an hour per start
]


class Table(NamedTuple):
    """Title of a table, its first columns, the settings of its rows, and the function that measures
    a row."""

    title: str
    first: tuple[str, ...]
    rows: list[dict[str, Any]]
    measure: Callable[..., dict[str, str]]


MEDIANS = f"medians of {rows.STARTS} starts, and their range"
KINDS = ("pillar", "ball", "mesh of a pillar", "mesh of a ball")
TABLES = {
    "faces": Table(
        f"Still water {held.DEPTH} m deep, finest spacing {held.FINE} m: pressure on faces against "
        r"$\rho g (H - y)$, vertical force over the displaced weight, and the integral of the "
        "measured pressure over the force by the ledger",
        ("body", "water"),
        [{"kind": kind, "water": water} for water in held.WATERS for kind in KINDS],
        held.faces,
    ),
    "sizes": Table(
        "Submerged balls by size, uniform water",
        ("radius over spacing",),
        [{"radius": r} for r in held.RADII],
        held.buoyancy,
    ),
    "gaps": Table(
        "Bodies at floor and wall by gap, uniform water: force over the displaced weight",
        ("body", "gap over spacing"),
        [{"kind": kind, "gap": gap} for kind, gap in held.GAPS],
        held.at_wall,
    ),
    "moving": Table(
        f"Balls that move at {held.SLOW} m/s at floor and wall: {held.WAY / held.FINE:g} spacings "
        "from or to the floor, or half a spacing from the wall and along it; uniform water: force "
        "over the displaced weight, means by the time since the start of the motion; " + MEDIANS,
        ("ball", "force"),
        [{"kind": kind} for kind in held.MOVES],
        held.moving,
    ),
    "collapse": Table(
        f"A column of water collapses past a ball under gravity {held.SLANTED} m/s²",
        ("radius over spacing",),
        [{"ratio": ratio} for ratio in held.SIZES],
        held.collapse,
    ),
    "drafts": Table(
        f"Floating cube and ball {floating.HEIGHT} m high, spacings across them: draft error over "
        "the height (goal: 2 %), and largest component of the cube's axes along the vertical, 1 if "
        "it lies flat, 0.71 on an edge, 0.58 on a corner; means over the last "
        f"{floating.BOBS:g} of {floating.AFLOAT:g} s (cubes, which start flat with a spin of "
        f"{floating.KICK:g} degrees/s: {floating.TURNING:g} s); {MEDIANS}",
        ("body", "density", "layers", "spacings"),
        [
            {"kind": kind, "density": density, "layers": layers}
            for kind in ("cube", "ball")
            for density in floating.DENSITIES
            for layers in held.WATERS.values()
        ]
        + [{"kind": "cube", "density": 750.0, "layers": 3, "fine": 0.5 * floating.FINE}],
        floating.draft,
    ),
    "drift": Table(
        f"Neutrally buoyant ball in 5 s (goal: 1 % of its diameter); {MEDIANS}",
        ("layers",),
        [{"layers": layers} for layers in held.WATERS.values()],
        floating.drift,
    ),
    "collisions": Table(
        "Water and a spinning cube collide without gravity: change of the momenta of water and "
        f"cube (goal: 1e-5) over their scales; {MEDIANS}",
        ("density over water's",),
        [{"density": density} for density in (50.0, 500.0, 20_000.0)],
        floating.collision,
    ),
    "hard": Table(
        f"Hard cases; {MEDIANS}",
        ("case",),
        [{"name": name} for name in floating.HARD],
        floating.hard,
    ),
    "heave": Table(
        "Heave decay of a half-submerged ball: time of the second crest and first trough against "
        "Kramer et al. 2021 and against potential flow (bench/heave_theory.py); medians over the "
        "starts",
        ("layers", "spacings per radius", "shear relief"),
        [
            dict(zip(("layers", "fine", "width", "starts", "depth", "relief"), case, strict=True))
            for case in HEAVES
        ],
        floating.heave,
    ),
}


def report(known: list[dict[str, str]], arch: str) -> str:
    """Returns the report as Markdown."""
    text = [heading("Bodies in water", arch)]
    for name, table in TABLES.items():
        found = [row for row in known if row["table"] == name]
        # The columns of the CSV file are in the order of all tables.
        lines = [
            {k: row[k] for k in (*table.first, *row) if row[k] and k not in KEYS} for row in found
        ]
        if lines:
            cells = tabulate(lines, "keys", "github", disable_numparse=True)
            text += [f"## {table.title}\n", cells, ""]
    return "\n".join(text)


@click.command()
@click.option("--only", multiple=True, type=click.Choice(list(TABLES)), help="Repeatable.")
@click.option("--resume", is_flag=True, help="Keep the rows of bodies.csv.")
@click.option("--arch", type=click.Choice(ARCHES), default="auto", show_default=True)
@click.option("--threads", type=int, help="CPU threads.")
@click.option("--worker", hidden=True, help="Measure one row, given as JSON.")
def main(
    only: tuple[str, ...], resume: bool, arch: str, threads: int | None, worker: str | None
) -> None:
    """Measure pressures, forces and energies, and write bench/results/bodies.{md,csv}."""
    if worker:
        table, settings, arch, threads = json.loads(worker)
        start(arch, threads)
        click.echo(json.dumps(TABLES[table].measure(**settings)))
        return
    known = rows.read(RESULTS / TABLE) if resume or only else []
    if not resume:
        known = [row for row in known if row["table"] not in only]
    tasks = [(name, row) for name in only or TABLES for row in TABLES[name].rows]
    for task in tqdm(tasks, unit="row"):
        own = dict(zip(KEYS, (task[0], json.dumps(task[1])), strict=True))
        if any(row.items() >= own.items() for row in known):
            continue
        known.append(own | rows.in_process(__file__, (*task, arch, threads), MAX_SECONDS))
        rows.write(RESULTS / TABLE, known)
    text = report(rows.read(RESULTS / TABLE), start(arch))
    (RESULTS / REPORT).write_text(text, encoding="utf-8")
    click.echo(text)


if __name__ == "__main__":
    main()
