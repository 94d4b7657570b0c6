"""Bodies in water against formulas: pressure on their faces, buoyancy, drafts, and energy.

python bench/bodies.py [--only drafts] [--resume] [--arch cpu] [--threads 1]

Every row runs in a separate process and is written to bench/results/bodies.csv when it ends;
--resume continues there, and --only keeps the rows of other tables.
"""

import itertools
import json
import math
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import click
import numpy as np
import trimesh
from tabulate import tabulate
from tqdm import tqdm

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from bench import floating, rows, tanks
from bench.heave_theory import decay
from bench.report import RESULTS, heading
from msph.device import ARCHES, start
from msph.fluid.external_forces import ExternalForces
from msph.measure.ledger import Ledger
from msph.measure.snapshot import Snapshot
from msph.scene.schema import Scene

TABLE, REPORT = "bodies.csv", "bodies.md"
# Columns that identify a row: its table and its settings.
KEYS = ("table", "settings")
# Longest wall-clock time of a row, and simulated time of runs to rest or past a ball [s].
MAX_SECONDS, SECONDS = 7200.0, 2.0
# Still water: edge of the square box, depth, finest spacing [m]; number of layers by name.
EDGE, DEPTH, FINE = 0.6, 0.4, 0.025
WATERS = {"uniform": 1, "layered": 3}
# Half width of the pillar, centre and radius of the ball, and radii of further balls [m].
HALF, MIDDLE, RADIUS = 0.075, (0.3, 0.2, 0.3), 0.1
RADII = (0.03, 0.05, 0.075, 0.15)
# Gravity [m/s^2] under which a column of water collapses past a ball, and the radii of the balls
# over the spacing (-).
SLANTED, SIZES = (5.0, -6.5, 5.0), (0.2, 0.5, 1.0, 1.5, 2.5, 4.0)
# Bodies next to floor and wall, with gaps in spacings; and heave decays: layers, finest spacing and
# width of the tank [m], starts, depth [m] and shear relief (-).
GAPS = [
    (kind, gap)
    for kind in ("ball on the floor", "ball at a wall", "box at a wall")
    for gap in ((0.05 if "box" in kind else 0.0), 0.5, 1.0, 2.0)
]
HEAVES = [
    (5, 0.025, 1.6, 3, 0.9, 0.0),
    (5, 0.025, 1.6, 3, 0.9, 1.0),
    (7, 0.01875, 1.6, 1, 0.9, 1.0),
    (7, 0.01875, 2.6, 3, 0.9, 1.0),  # half an hour per start
]
# Share of a run before the measurement starts, in which the water settles.
SETTLING = 0.5
# Balls that move at floor and wall after HELD [s] at rest: speed [m/s], way [m], and time of an
# average [s].
SLOW, WAY, HELD, MEAN = 0.05, 0.075, 1.5, 0.25
MOVES = ("sinks to the floor", "rises from the floor", "passes along the wall")


def still_water(bodies: list[dict[str, Any]], layers: int, seed: int = 0) -> Any:
    """Returns a simulation of a tank of still water with bodies."""
    tank = tanks.tank((EDGE, EDGE), DEPTH, FINE, layers, air=0.15, seed=seed)
    return tanks.build(Scene.model_validate({**tank.model_dump(), "bodies": bodies}))


def sphere(n: int) -> np.ndarray:
    """Returns n evenly spread unit vectors, (n, 3), by the golden section."""
    y = 1.0 - 2.0 * (np.arange(n) + 0.5) / n
    turn, ring = np.pi * (3.0 - 5.0**0.5) * np.arange(n), np.sqrt(1.0 - y**2)
    return np.column_stack([ring * np.cos(turn), y, ring * np.sin(turn)])


def settle(sim: Any, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, Ledger]:
    """Runs a simulation; returns the mean pressures [Pa] at points (n, 3) [m] and the mean force
    on the bodies [N] after the water has settled, and the ledger of the whole run."""
    ledger, readings = Ledger(sim, density_every=math.inf), []
    gravity, frames = (0.0, -tanks.GRAVITY, 0.0), round(SECONDS / tanks.FRAME)
    settled = round(SETTLING * frames)
    ledger.record(gravity)
    for frame in range(1, frames + 1):
        sim.advance(tanks.FRAME, ExternalForces(gravity))
        ledger.record(gravity)
        if frame > settled and frame % 6 == 0:
            readings.append(Snapshot.of(sim).pressures(points) if len(points) else [])
    first, last = ledger.entries[settled], ledger.entries[-1]
    force = (first.body_impulse - last.body_impulse) / (last.time - first.time)
    return np.mean(readings, axis=0), force, ledger


def pillar_points(lo: np.ndarray, hi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns points (n, 3) on the four sides of a pillar, below the surface, and their normals."""
    y, across = (a.ravel() for a in np.meshgrid(np.linspace(0.05, 0.3, 6), np.linspace(0, 1, 5)))
    points, normals = [], []
    for axis, other in ((0, 2), (2, 0)):
        for end, sign in ((lo, -1.0), (hi, 1.0)):
            side, normal = np.zeros((y.size, 3)), np.zeros((y.size, 3))
            side[:, axis], normal[:, axis] = end[axis], sign
            side[:, 1], side[:, other] = y, lo[other] + across * (hi - lo)[other]
            points.append(side)
            normals.append(normal)
    return np.concatenate(points), np.concatenate(normals)


def worst_side(ratio: np.ndarray, normals: np.ndarray) -> float:
    """Returns the largest mean error (-) of the sides; points with normals (n, 3) in the same
    direction belong to the same side."""
    axis = np.abs(normals).argmax(axis=1)
    sides = 2 * axis + (np.take_along_axis(normals, axis[:, None], axis=1)[:, 0] > 0.0)
    means = [ratio[sides == side].mean() for side in np.unique(sides)]
    return max(means, key=abs)


def faces(kind: str, water: str) -> dict[str, str]:
    """Returns the table row of the pressures on a body in still water."""
    layers, sunk = WATERS[water], 0.0
    lo, hi = np.array(MIDDLE) - HALF, np.array(MIDDLE) + HALF
    mesh = kind.startswith("mesh")
    if kind.endswith("ball"):
        normals = sphere(60)
        points, areas = np.array(MIDDLE) + RADIUS * normals, 4.0 * math.pi * RADIUS**2 / 60
        body: dict[str, Any] = {"centre": MIDDLE, "radius": RADIUS}
        shape = trimesh.creation.icosphere(4, radius=RADIUS).apply_translation(MIDDLE)
        sunk, area = 4.0 / 3.0 * math.pi * RADIUS**3, EDGE**2
        if mesh:  # its faces lie inside the ball
            points, normals, areas = shape.triangles_center, shape.face_normals, shape.area_faces
            sunk = shape.volume
    else:
        points, normals = pillar_points(lo, hi)
        areas = math.nan
        body = {"lo": [lo[0], 0.0, lo[2]], "hi": [hi[0], DEPTH + 0.1, hi[2]]}
        below = 0.1  # a mesh on the floor should reach into it
        shape = trimesh.creation.box((2.0 * HALF, DEPTH + 0.1 + below, 2.0 * HALF))
        shape.apply_translation((MIDDLE[0], 0.5 * (DEPTH + 0.1 - below), MIDDLE[2]))
        area = EDGE**2 - 4.0 * HALF**2
    if mesh:
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "body.obj"
            shape.export(file)
            sim = still_water([{"mesh": str(file)}], layers)
    else:
        sim = still_water([body], layers)
    mass = sum(n * spec.mass for n, spec in zip(sim.counts(), sim.layers.specs, strict=True))
    level = (mass / 1000.0 + sunk) / area
    found, force, ledger = settle(sim, points)
    ratio = found / (1000.0 * tanks.GRAVITY * (level - points[:, 1])) - 1.0
    row = {
        "body": kind,
        "water": water,
        "pressure, mean": f"{ratio.mean():+.2%}",
        "worst side, mean": f"{worst_side(ratio, normals):+.2%}",
        "rms": f"{np.sqrt((ratio**2).mean()):.2%}",
        "worst point": f"{ratio[np.abs(ratio).argmax()]:+.2%}",
        "force over displaced weight": "-",
        "pressure integral over force": "-",
        "energy rise in 1 s": f"{ledger.energy_rise():.3%}",
    }
    if sunk:
        integral = -np.sum(found * normals[:, 1] * areas)
        row["force over displaced weight"] = f"{force[1] / (1000.0 * tanks.GRAVITY * sunk):.2%}"
        row["pressure integral over force"] = f"{integral / force[1] - 1.0:+.2%}"
    return row


def buoyancy(radius: float) -> dict[str, str]:
    """Returns the table row of the force on a submerged ball of `radius` [m]."""
    sim = still_water([{"centre": MIDDLE, "radius": radius}], 1)
    _, force, _ = settle(sim, np.zeros((0, 3)))
    weight = 1000.0 * tanks.GRAVITY * 4.0 / 3.0 * math.pi * radius**3
    return {
        "radius over spacing": f"{radius / FINE:.1f}",
        "force over displaced weight": f"{force[1] / weight:.2%}",
    }


def at_wall(kind: str, gap: float) -> dict[str, str]:
    """Returns the table row of the force on a body `gap` spacings from the floor or a wall."""
    near = gap * FINE
    if kind == "box at a wall":
        # A swing with an amplitude of 1e-9 m, since a moving box is not extended into the wall.
        lo, hi = [near, 0.1, 0.2], [near + 0.2, 0.3, 0.4]
        body: dict[str, Any] = {"lo": lo, "hi": hi, "swing": [1e-9, 0, 0]}
        displaced = 0.2**3
    else:
        place = [EDGE / 2, near + RADIUS, EDGE / 2]
        body = {"centre": place if kind == "ball on the floor" else [place[1], 0.2, place[0]]}
        body["radius"], displaced = RADIUS, 4.0 / 3.0 * math.pi * RADIUS**3
    _, force, _ = settle(still_water([body], 1), np.zeros((0, 3)))
    force = force / (1000.0 * tanks.GRAVITY * displaced)
    return {
        "body": kind,
        "gap over spacing": f"{gap:g}",
        "vertical": f"{force[1]:.1%}",
        "away from the wall": f"{force[0]:+.1%}",
    }


def moving(kind: str) -> dict[str, str]:
    """Returns the table row of the force on a ball that moves slowly at the floor or a wall, over
    its displaced weight: means over successive MEAN [s]."""
    gap = {"sinks to the floor": WAY, "rises from the floor": 0.0}.get(kind, 0.5 * FINE)
    way = f"{SLOW}*min(max(t - {HELD}, 0), {WAY / SLOW})"
    if "floor" in kind:
        centre = [EDGE / 2, gap + RADIUS, EDGE / 2]
        path, axis = ["0", way if gap == 0.0 else f"-{way}", "0"], 1
    else:
        centre, path, axis = [gap + RADIUS, 0.2, (EDGE - WAY) / 2], ["0", "0", way], 0
    body = {"centre": centre, "radius": RADIUS, "displacement": path}
    weight = 1000.0 * tanks.GRAVITY * 4.0 / 3.0 * math.pi * RADIUS**3
    ends = np.arange(0.0, WAY / SLOW + MEAN / 2, MEAN)
    spans = [f"{a:g} to {b:g} s" for a, b in itertools.pairwise(ends)]

    def case(seed: int) -> dict[str, float]:
        sim = still_water([body], 1, seed)
        tanks.run(sim, HELD)
        found = {}
        for name in spans:
            begin, impulse = sim.time, float(sim.boundary.impulse[0, axis])
            tanks.run(sim, MEAN)
            force = (float(sim.boundary.impulse[0, axis]) - impulse) / (sim.time - begin)
            found[name] = force / weight
        return found

    return {
        "ball": kind,
        "force": "vertical" if axis == 1 else "away from the wall",
        **rows.over_starts(case, dict.fromkeys(spans, ".1%")),
    }


def collapse(ratio: float) -> dict[str, str]:
    """Returns the table row of the energy of a column of water that collapses past a ball of
    `ratio` spacings radius."""
    spacing = 0.03
    ball = {"centre": [0.4, 0.1, 0.35], "radius": ratio * spacing}
    scene = {
        "box": {"size": [EDGE, EDGE, EDGE]},
        "layers": [{"spacing": spacing}],
        "water": [{"lo": [0, 0, 0], "hi": [0.3, 0.4, EDGE]}],
        "bodies": [ball],
    }
    sim = tanks.build(Scene.model_validate(scene))
    ledger = Ledger(sim)
    ledger.record(SLANTED)
    for _ in range(round(SECONDS / tanks.FRAME)):
        sim.advance(tanks.FRAME, ExternalForces(SLANTED))
        ledger.record(SLANTED)
    return {
        "radius over spacing": f"{ratio:g}",
        "energy rise in 1 s": f"{ledger.energy_rise():.3%}",
        "solver residual, 99th percentile": f"{ledger.solver_residual()[1]:.2%}",
        "outside": str(max(e.outside for e in ledger.entries)),
    }


class Table(NamedTuple):
    """Title of a table, its first columns, the settings of its rows, and the function that measures
    a row."""

    title: str
    first: tuple[str, ...]
    rows: list[dict[str, Any]]
    measure: Callable[..., dict[str, str]]


HEAVE = decay(floating.RELEASE, floating.RADIUS, floating.KRAMER_GRAVITY, 1.0)
MEDIANS = f"medians of {rows.STARTS} starts, and their range"
KINDS = ("pillar", "ball", "mesh of a pillar", "mesh of a ball")
TABLES = {
    "faces": Table(
        f"Still water {DEPTH} m deep, finest spacing {FINE} m: pressure on faces against "
        r"$\rho g (H - y)$, vertical force over the displaced weight, and the integral of the "
        "measured pressure over the force by the ledger",
        ("body", "water"),
        [{"kind": kind, "water": water} for water in WATERS for kind in KINDS],
        faces,
    ),
    "sizes": Table(
        "Submerged balls by size, uniform water",
        ("radius over spacing",),
        [{"radius": r} for r in RADII],
        buoyancy,
    ),
    "gaps": Table(
        "Bodies at floor and wall by gap, uniform water: force over the displaced weight",
        ("body", "gap over spacing"),
        [{"kind": kind, "gap": gap} for kind, gap in GAPS],
        at_wall,
    ),
    "moving": Table(
        f"Balls that move at {SLOW} m/s at floor and wall: {WAY / FINE:g} spacings from or to "
        "the floor, or half a spacing from the wall and along it; uniform water: force "
        "over the displaced weight, means by the time since the start of the motion; " + MEDIANS,
        ("ball", "force"),
        [{"kind": kind} for kind in MOVES],
        moving,
    ),
    "collapse": Table(
        f"A column of water collapses past a ball under gravity {SLANTED} m/s²",
        ("radius over spacing",),
        [{"ratio": ratio} for ratio in SIZES],
        collapse,
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
            for layers in WATERS.values()
        ]
        + [{"kind": "cube", "density": 750.0, "layers": 3, "fine": 0.5 * floating.FINE}],
        floating.draft,
    ),
    "drift": Table(
        f"Neutrally buoyant ball in 5 s (goal: 1 % of its diameter); {MEDIANS}",
        ("layers",),
        [{"layers": layers} for layers in WATERS.values()],
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
        "Kramer et al. 2021 and against potential flow (bench/heave_theory.py, {:.3f} s and "
        "{:.4f} m); medians over the starts".format(*floating.first_period(*HEAVE)),
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
