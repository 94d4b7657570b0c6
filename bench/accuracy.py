"""Errors of the projection method against formulas, for uniform and layered water.

python bench/accuracy.py [--seconds 10] [--starts 3] [--only still] [--resume] [--arch cpu]

Starts differ in the random initial displacements of the particles, 0.02 spacings, and in the case
"collision" in the positions of the lattices. A difference between uniform and layered water is
significant only if it exceeds the range over the starts. Every part runs in a separate process and
is written to bench/results/accuracy.csv when it ends; --resume continues there.
"""

import json
import sys
from dataclasses import astuple, dataclass
from pathlib import Path

import click
import numpy as np
from tabulate import tabulate

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from bench import rows, tanks
from bench.report import RESULTS, heading
from msph.device import ARCHES, start
from msph.fluid.adaptivity.bands import AdaptationParameters
from msph.fluid.external_forces import ExternalForces
from msph.fluid.particles.layers import LayerSpec
from msph.fluid.plan import Plan
from msph.fluid.projection.parameters import ProjectionParameters
from msph.fluid.projection.solver import Projection
from msph.fluid.simulation import Simulation

# Kinds of water: number of layers, and changed adaptation parameters. "uniform, irregular" starts
# like layered water, from cubes halved along random axes, but all particles have the finest size
# (bands reach the floor, no pass follows): it shows the errors due to the initial arrangement.
WATERS: dict[str, tuple[int, dict[str, float]]] = {
    "uniform": (1, {}),
    "uniform, irregular": (3, {"band": 30.0, "every": 10**9}),
    "layered": (4, {}),
}
# Still water: finest spacing [m], and depth in spacings; the column is 10 spacings wide.
FINE, SPACINGS_DEEP = 0.02, 60
# Sloshing: length of the box and depth [m], amplitude over depth (-), depths in finest spacings;
# the lowest wave is half a spacing high. At a single depth the error may vanish by chance.
LENGTH, DEPTH, AMPLITUDE, SPACINGS = 1.0, 0.5, 0.05, (10, 12, 15, 20, 25)
SLOSH_SECONDS = 5.0
# Falling in a duct: edge [m], viscosity [Pa s], finest spacings across; times between which it is
# measured [s], and distance of the measured heights from the ends of the column at the start, in
# edges: the column falls, and both ends bulge in the duct's middle.
EDGE, VISCOSITY, ACROSS = 0.2, 100.0, (10, 16)
DUCT_BEGIN, DUCT_END, FROM_ENDS = 0.1, 0.35, 1.25
# Time limit of a part [s].
MAX_SECONDS = 3600
TABLE = "accuracy.csv"
# Formats of figures: counts, shares in percent, energies [J], drifts.
WHOLE, SHARE, JOULE, DRIFT = "{:,.0f}", "{:.3%}", "{:.3g}", "{:.1e}"


@dataclass(frozen=True)
class Figure:
    """A figure: name, limit, format, and value [- or J]."""

    name: str
    limit: str
    form: str
    value: float


def still(kind: str, seconds: float, seed: int) -> list[Figure]:
    """Returns the figures of water that should remain at rest."""
    layers, changes = WATERS[kind]
    footprint = (10 * FINE, 10 * FINE)
    scene = tanks.tank(footprint, SPACINGS_DEEP * FINE, FINE, layers, seed=seed, **changes)
    sim = tanks.build(scene)
    reading = tanks.Reading(sim)
    reading.read()
    tanks.run(sim, 1.0, reading)
    changed = np.array(sim.counts())
    later, profile = tanks.Reading(sim), tanks.Profile(sim, reading.depth)
    tanks.run(sim, seconds - 1.0, later, profile)
    changed = int(np.abs(changed - sim.counts()).sum())
    frames = round(1.0 / tanks.FRAME)
    rise = max(reading.energy_rise(), later.energy_rise())
    profiled = "pressure error against rho g (H - y), rms over depth"
    return [
        Figure("particles", "", WHOLE, sim.particles.count),
        Figure(f"{profiled}, probes", "2 %", SHARE, profile.error()),
        Figure(f"{profiled}, particle means", "2 %", SHARE, later.pressure_error()),
        Figure("solver residual, mean", "0.2 %", SHARE, float(np.mean(later.error_mean))),
        Figure("solver residual, 99th percentile", "", SHARE, float(np.mean(later.error_p99))),
        Figure("solver residual, largest", "2 %", SHARE, max(later.error_max)),
        Figure("height of the centre of mass against rest", "1 %", SHARE, later.volume_error()),
        Figure("energy, largest rise in 1 s", "0.1 %", SHARE, rise),
        Figure("kinetic energy, first second, J", "", JOULE, np.mean(reading.kinetic[-frames:])),
        Figure("kinetic energy, last second, J", "decays", JOULE, np.mean(later.kinetic[-frames:])),
        Figure(f"particles that changed layer in {seconds - 1:g} s", "", WHOLE, changed),
    ]


def sloshing(kind: str, spacings: int, seed: int) -> tuple[list[Figure], np.ndarray]:
    """Returns the figures of a sloshing tank, and the position of its centre of mass along x at
    each frame [m]."""
    fine = DEPTH / spacings
    layers, changes = WATERS[kind]
    scene = tanks.tank((LENGTH, 10 * fine), DEPTH, fine, layers, seed=seed, **changes)
    sim = tanks.build(scene)
    tanks.run(sim, 1.0)
    tanks.slosh(sim, DEPTH, AMPLITUDE * DEPTH)
    reading = tanks.Reading(sim)
    tanks.run(sim, SLOSH_SECONDS, reading)
    x = np.array(reading.centres)[:, 0]
    theory = tanks.slosh_period(LENGTH, DEPTH)
    found = tanks.fitted_period([t - 1.0 for t in reading.times], x, theory)
    mean = float(np.mean(reading.error_mean))
    figures = [
        Figure("particles", "", WHOLE, sim.particles.count),
        Figure(f"period against linear theory, {theory:.3f} s", "1 %", SHARE, found / theory - 1.0),
        Figure("solver residual, mean", "", SHARE, mean),
        Figure("solver residual, 99th percentile", "", SHARE, float(np.mean(reading.error_p99))),
        Figure("solver residual, largest", "", SHARE, max(reading.error_max)),
        Figure("energy, largest rise in 1 s", "0.1 %", SHARE, reading.energy_rise()),
        Figure(
            "the same over kinetic plus available potential energy",
            "",
            SHARE,
            reading.energy_rise_of_motion(),
        ),
        Figure("height of the centre of mass against rest", "1 %", SHARE, reading.volume_error()),
    ]
    return figures, x


def duct(kind: str, spacings: int, seed: int) -> list[Figure]:
    """Returns the figures of viscous water that falls in a square duct without slip."""
    layers, changes = WATERS[kind]
    sim = tanks.build(tanks.duct(EDGE, spacings, VISCOSITY, layers, seed, **changes))
    tanks.run(sim, DUCT_BEGIN)
    masses = np.array([s.mass for s in sim.layers.specs])
    bottom, top = tanks.DUCT_WATER
    flows, sheets = [], []
    while sim.time < DUCT_END:
        tanks.run(sim, tanks.FRAME)
        x, v = (sim.particles.numpy(name).astype(float) for name in ("x", "v"))
        m = masses[sim.particles.numpy("layer")]
        theory = tanks.duct_speed(x[:, 0], x[:, 2], EDGE, VISCOSITY / 1000.0, sim.time)
        height = x[:, 1] / EDGE
        middle = (height > bottom + FROM_ENDS) & (height < top - FROM_ENDS)
        side = np.minimum(x[:, [0, 2]], EDGE - x[:, [0, 2]]).min(axis=1)
        sheet = middle & (side < np.cbrt(m / 1000.0))
        for errors, at in ((flows, middle), (sheets, sheet)):
            errors.append(-(m * v[:, 1])[at].sum() / (m * theory)[at].sum() - 1.0)
    limit = "3 %, layers 5 %"
    return [
        Figure("particles", "", WHOLE, sim.particles.count),
        Figure("flow against theory, mean over time", limit, SHARE, float(np.mean(flows))),
        Figure("speed within a spacing of the walls", "", SHARE, float(np.mean(sheets))),
    ]


def collision(start: int) -> list[Figure]:
    """Returns the figures of two balls that collide off centre without gravity, with splits and
    merges."""
    rng = np.random.default_rng(start)
    d, middle, radius = 0.025, 1.2, 0.15
    specs = [LayerSpec(1000.0 * d**3 * 2**k, 1000.0, Projection.SMOOTHING) for k in range(3)]
    balls = []
    for k, at in ((0, (-0.18, 0.04, 0.0)), (2, (0.18, -0.04, 0.0))):
        spacing = specs[k].spacing
        n = int(radius / spacing) + 2
        axis = (np.arange(-n, n) + 0.5) * spacing
        grid = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), -1).reshape(-1, 3)
        grid += rng.uniform(-0.5, 0.5, 3) * spacing
        balls.append(grid[np.linalg.norm(grid, axis=1) < radius] + at + middle)
    x = np.concatenate(balls).astype(np.float32)
    v = np.zeros_like(x)
    v[: len(balls[0]), 0], v[len(balls[0]) :, 0] = 1.0, -1.0
    layer = np.repeat([0, 2], [len(b) for b in balls]).astype(np.int32)
    initial = {"x": x, "v": v, "layer": layer}
    adaptation = AdaptationParameters(band=0.7, every=2)
    sim = Simulation(
        Plan((2.4, 2.4, 2.4), specs, initial, ProjectionParameters(), (), adaptation, capacity=5000)
    )

    def momenta():
        m = np.array([s.mass for s in specs])[sim.particles.numpy("layer")][:, None]
        x, v = (sim.particles.numpy(name).astype(float) for name in ("x", "v"))
        arm, speed = x - middle, np.linalg.norm(v, axis=1)
        scales = (m[:, 0] * speed).sum(), (m[:, 0] * np.linalg.norm(arm, axis=1) * speed).sum()
        return m.sum(), (m * v).sum(axis=0), (m * np.cross(arm, v)).sum(axis=0), scales

    mass, linear, angular, (scale, spin) = momenta()
    before = set(sim.particles.numpy("id"))
    # Thin bands, as in a pool near its capacity, cause merges; full bands then cause splits.
    for thickness in (0.35, 1.0):
        sim.solver.adaptation.thickness = thickness
        for _ in range(12):
            sim.advance(tanks.FRAME, ExternalForces(gravity=(0.0, 0.0, 0.0)))
    after = set(sim.particles.numpy("id"))
    mass_after, linear_after, angular_after, _ = momenta()
    drift = np.linalg.norm(linear_after - linear) / scale
    turned = np.linalg.norm(angular_after - angular) / spin
    return [
        Figure("particles created", "", WHOLE, len(after - before)),
        Figure("particles removed", "", WHOLE, len(before - after)),
        Figure("mass drift", "0", DRIFT, abs(mass_after / mass - 1.0)),
        Figure("momentum drift over sum m v", "1e-05", DRIFT, drift),
        Figure("angular momentum drift over sum m r v", "1e-04", DRIFT, turned),
    ]


def part(name: str, kind: str, spacings: int, start: int, seconds: float) -> list[tuple]:
    """Returns the rows (case, water, name, limit, format, value) of a part of the table."""
    found: list[tuple[str, str, Figure]] = []
    if name == "still":
        case = f"still water, {SPACINGS_DEEP} fine spacings deep, {seconds:g} s"
        found += [(case, kind, f) for f in still(kind, seconds, start)]
    elif name == "sloshing":
        case = f"sloshing, amplitude {AMPLITUDE:.0%} of the depth, {spacings} spacings deep"
        apart = f"largest distance of the centre of mass from uniform in {SLOSH_SECONDS:g} s"
        centres = {}
        for water in WATERS:
            figures, centres[water] = sloshing(water, spacings, start)
            found += [(case, water, f) for f in figures]
            if water != "uniform":
                far = np.abs(centres[water] - centres["uniform"]).max() / LENGTH
                figure = Figure(f"{apart}, over length", "1 %", SHARE, far)
                found.append((case, water, figure))
    elif name == "duct":
        case = f"falling in a square duct without slip, {spacings} spacings across"
        found += [(case, kind, f) for f in duct(kind, spacings, start)]
    else:
        found += [("collision of a fine and a coarse ball", "layered", f) for f in collision(start)]
    return [(case, water, *astuple(figure)) for case, water, figure in found]


def parts(starts: int) -> list[tuple[str, str, int, int]]:
    """Returns the parts: name, kind of water, depth or width in spacings, start; one start after
    another."""
    found: list[tuple[str, str, int, int]] = []
    for seed in range(starts):
        found += [("still", kind, 0, seed) for kind in WATERS]
        found += [("duct", kind, n, seed) for n in ACROSS for kind in WATERS]
        found += [("sloshing", "", n, seed) for n in SPACINGS] + [("collision", "", 0, seed)]
    return found


def table(known: list[dict], case: str) -> str:
    """Returns a Markdown table with a row per figure and a column per kind of water: median
    (minimum to maximum) over the starts."""
    own = [row for row in known if row["case"] == case]
    waters = list(dict.fromkeys(row["water"] for row in own))
    lines = []
    for name, limit, form in dict.fromkeys((r["name"], r["limit"], r["form"]) for r in own):
        of = [
            [float(r["value"]) for r in own if (r["water"], r["name"]) == (water, name)]
            for water in waters
        ]
        lines.append((name, limit, *(rows.spread(v, form) if v else "" for v in of)))
    return tabulate(lines, ("figure", "limit", *waters), tablefmt="github", disable_numparse=True)


def over_depths(known: list[dict]) -> list[dict]:
    """Returns the rows of the root mean square of the errors of the period over the depths, for
    each kind of water and start."""
    errors: dict[tuple[str, str], list[float]] = {}
    for row in known:
        if row["name"].startswith("period"):
            errors.setdefault((row["water"], row["start"]), []).append(float(row["value"]))
    name = "period against linear theory, rms over depths"
    return [
        {
            **{"case": "sloshing, all depths", "water": water, "start": start, "name": name},
            **{"limit": "", "form": SHARE, "value": float(np.sqrt(np.mean(np.square(found))))},
        }
        for (water, start), found in errors.items()
    ]


@click.command()
@click.option("--seconds", default=10.0, show_default=True, help="Simulated time of still water.")
@click.option(
    "--starts",
    default=rows.STARTS,
    show_default=True,
    type=click.IntRange(1),
    help="Number of random initial arrangements.",
)
@click.option(
    "--only", multiple=True, help="Part to run: still, duct, sloshing, collision. Repeatable."
)
@click.option("--resume", is_flag=True, help="Keep the rows of earlier runs.")
@click.option("--arch", type=click.Choice(ARCHES), default="auto", show_default=True)
@click.option("--worker", hidden=True)
def main(seconds: float, starts: int, only, resume: bool, arch: str, worker: str | None) -> None:
    """Measure the errors and write bench/results/accuracy.{md,csv}."""
    arch = start(arch)
    if worker:
        print(json.dumps({"rows": part(*json.loads(worker))}))
        return
    known: list[dict] = rows.read(RESULTS / TABLE) if resume or only else []
    for task in parts(starts):
        name, kind, spacings, seed = task
        label = " ".join(str(word) for word in (name, kind, spacings) if word)
        if (only and name not in only) or (label, str(seed)) in {
            (row["part"], str(row["start"])) for row in known
        }:
            continue
        found = rows.in_process(__file__, (*task, seconds), MAX_SECONDS)
        click.echo(f"{label}, start {seed + 1} of {starts} {found.get('failure', '')}")
        heads = ("case", "water", "name", "limit", "form", "value")
        known += [
            {"part": label, "start": seed, **dict(zip(heads, row, strict=True))}
            for row in found.get("rows", [])
        ]
        rows.write(RESULTS / TABLE, known)
    known += over_depths(known)
    count = len({str(row["start"]) for row in known})
    report = [heading("Errors of the projection method", arch)]
    report.append(f"{count} random initial arrangements: median (minimum to maximum).\n")
    for case in dict.fromkeys(row["case"] for row in known):
        report += [f"## {case[0].upper()}{case[1:]}\n", table(known, case), ""]
    (RESULTS / "accuracy.md").write_text("\n".join(report))
    click.echo("\n".join(report))


if __name__ == "__main__":
    main()
