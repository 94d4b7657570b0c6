"""Errors of the projection method against formulas, uniform and layered alike.

python bench/accuracy.py [--seconds 10] [--starts 3] [--arch cpu]

Starts differ by where particles are put at random within a fiftieth of a spacing; what is said of
one water against another should be more than they differ by among themselves.
"""

import csv
import statistics
import sys
from dataclasses import dataclass
from pathlib import Path

import click
import numpy as np
from tabulate import tabulate

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from bench import tanks
from bench.report import RESULTS, heading
from msph.device import ARCHES, start
from msph.fluid.adaptivity.bands import AdaptationParameters
from msph.fluid.external_forces import ExternalForces
from msph.fluid.particles.layers import LayerSpec
from msph.fluid.plan import Plan
from msph.fluid.projection.parameters import ProjectionParameters
from msph.fluid.projection.solver import Projection
from msph.fluid.simulation import Simulation

# What is measured: layers, and what changes in adaptation. A start from cubes halved at random, as
# layers have it, but all to the finest size, tells how much of the errors is the arrangement's:
# bands so thick that they reach the floor, and nothing adapts.
WATERS: dict[str, tuple[int, dict[str, float]]] = {
    "uniform": (1, {}),
    "uniform, irregular": (3, {"band": 30.0, "every": 10**9}),
    "layered": (4, {}),
}
# Still water: 60 fine spacings deep, in a column ten wide.
FINE, SHEETS_DEEP = 0.02, 60
# Sloshing: box length and depth [m], amplitude as a share of the depth, fine spacings per depth:
# from waves half a spacing high on. Errors of one depth alone may vanish by chance.
LENGTH, DEPTH, AMPLITUDE, SPACINGS = 1.0, 0.5, 0.05, (10, 12, 15, 20, 25)
SLOSH_SECONDS = 5.0
# Eighteen waters each: of more a process has no room for the fields.
MOST_STARTS = 3
# How figures are printed: counts, shares as percent, joules, drifts.
WHOLE, SHARE, JOULE, DRIFT = "{:,.0f}", "{:.3%}", "{:.3g}", "{:.1e}"


@dataclass(frozen=True)
class Figure:
    """What is measured, the bound it should keep, how it is printed, and its value (-, J)."""

    name: str
    bound: str
    form: str
    value: float


def still(kind: str, seconds: float, seed: int) -> list[Figure]:
    """Figures of water that should stay where it is."""
    layers, changes = WATERS[kind]
    footprint = (10 * FINE, 10 * FINE)
    scene = tanks.tank(footprint, SHEETS_DEEP * FINE, FINE, layers, seed=seed, **changes)
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
    profiled = "pressure against rho g (H - y), rms over depth"
    return [
        Figure("particles", "", WHOLE, sim.particles.count),
        Figure(f"{profiled}, of probes", "2 %", SHARE, profile.error()),
        Figure(f"{profiled}, of particles in sheets", "2 %", SHARE, later.pressure_error()),
        Figure("density error, mean", ".2 %", SHARE, float(np.mean(later.error_mean))),
        Figure("density error, 99th percentile", "", SHARE, float(np.mean(later.error_p99))),
        Figure("density error, largest", "2 %", SHARE, max(later.error_max)),
        Figure("height of the centre against rest", "1 %", SHARE, later.volume_error()),
        Figure("energy, largest rise in 1 s", ".1 %", SHARE, rise),
        Figure("kinetic energy, first second, J", "", JOULE, np.mean(reading.kinetic[-frames:])),
        Figure("kinetic energy, last second, J", "decays", JOULE, np.mean(later.kinetic[-frames:])),
        Figure(f"particles that changed layer in {seconds - 1:g} s", "", WHOLE, changed),
    ]


def sloshing(kind: str, spacings: int, seed: int) -> tuple[list[Figure], np.ndarray]:
    """Figures of a sloshing tank, and the way of its centre of mass along the box [m]."""
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
        Figure("density error, mean", "", SHARE, mean),
        Figure("density error, 99th percentile", "", SHARE, float(np.mean(reading.error_p99))),
        Figure("density error, largest", "", SHARE, max(reading.error_max)),
        Figure("energy, largest rise in 1 s", ".1 %", SHARE, reading.energy_rise()),
        Figure("height of the centre against rest", "1 %", SHARE, reading.volume_error()),
    ]
    return figures, x


def over_depths(periods: list[float]) -> list[Figure]:
    """Of errors of the period, one a depth (-)."""
    square = float(np.sqrt(np.mean(np.square(periods))))
    return [Figure("period against linear theory, rms over depths", "", SHARE, square)]


def collision() -> list[Figure]:
    """Figures of two blobs that collide without gravity, off centre, splits and merges on."""
    d, middle, radius = 0.025, 1.2, 0.15
    specs = [LayerSpec(1000.0 * d**3 * 2**k, 1000.0, Projection.SMOOTHING) for k in range(3)]
    balls = []
    for k, at in ((0, (-0.18, 0.04, 0.0)), (2, (0.18, -0.04, 0.0))):
        spacing = specs[k].spacing
        n = int(radius / spacing) + 1
        axis = (np.arange(-n, n) + 0.5) * spacing
        grid = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), -1).reshape(-1, 3)
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
    # Thin bands, as in a full pool, make it merge; wide ones split what was merged.
    for thickness in (0.35, 1.0):
        sim.solver.adaptation.thickness = thickness
        for _ in range(12):
            sim.advance(tanks.FRAME, ExternalForces(gravity=(0.0, 0.0, 0.0)))
    after = set(sim.particles.numpy("id"))
    mass_after, linear_after, angular_after, _ = momenta()
    drift = np.linalg.norm(linear_after - linear) / scale
    turned = np.linalg.norm(angular_after - angular) / spin
    return [
        Figure("particles born", "", WHOLE, len(after - before)),
        Figure("particles gone", "", WHOLE, len(before - after)),
        Figure("mass drift", "0", DRIFT, abs(mass_after / mass - 1.0)),
        Figure("momentum drift over sum m v", "1e-05", DRIFT, drift),
        Figure("angular momentum drift over sum m r v", "1e-04", DRIFT, turned),
    ]


class Record:
    """Every figure of every start: (case, water, start, figure, bound, value) in order."""

    def __init__(self) -> None:
        self.rows: list[tuple[str, str, int, Figure]] = []

    def add(self, case: str, water: str, start: int, figures: list[Figure]) -> None:
        self.rows += [(case, water, start, figure) for figure in figures]

    def table(self, case: str) -> str:
        """A line a figure and a column a water, as Markdown: median (least to most)."""
        own = [row for row in self.rows if row[0] == case]
        waters = list(dict.fromkeys(row[1] for row in own))
        lines = []
        for name, bound in dict.fromkeys((row[3].name, row[3].bound) for row in own):
            of = [[r[3] for r in own if r[1] == water and r[3].name == name] for water in waters]
            lines.append((name, bound, *map(spread, of)))
        headers = ("figure", "bound", *waters)
        return tabulate(lines, headers, tablefmt="github", disable_numparse=True)


def spread(figures: list[Figure]) -> str:
    """Median (least to most) of one figure's values over the starts."""
    if not figures:
        return ""
    values, form = [f.value for f in figures], figures[0].form
    numbers = statistics.median(values), min(values), max(values)
    middle, least, most = (form.format(v).replace("%", " %") for v in numbers)
    return middle if least == most else f"{middle} ({least} to {most})"


@click.command()
@click.option("--seconds", default=10.0, show_default=True, help="Simulated time of still water.")
@click.option("--starts", default=3, show_default=True, type=click.IntRange(1, MOST_STARTS))
@click.option("--arch", type=click.Choice(ARCHES), default="auto", show_default=True)
def main(seconds: float, starts: int, arch: str) -> None:
    """Measure and write bench/results/accuracy.{md,csv}."""
    arch = start(arch)
    record = Record()
    depth = f"still water, {SHEETS_DEEP} fine spacings deep, {seconds:g} s"
    for seed in range(starts):
        for kind in WATERS:
            record.add(depth, kind, seed, still(kind, seconds, seed))
            click.echo(f"{depth}: {kind}, start {seed + 1} of {starts}")
    periods: dict[tuple[str, int], list[float]] = {}
    apart = f"centre of mass from uniform, most in {SLOSH_SECONDS:g} s, over the length"
    for spacings in SPACINGS:
        waves = f"sloshing, amplitude {AMPLITUDE:.0%} of the depth, {spacings} spacings deep"
        for seed in range(starts):
            centres = {}
            for kind in WATERS:
                figures, centres[kind] = sloshing(kind, spacings, seed)
                record.add(waves, kind, seed, figures)
                error = next(f.value for f in figures if f.name.startswith("period"))
                periods.setdefault((kind, seed), []).append(error)
                if kind != "uniform":
                    far = np.abs(centres[kind] - centres["uniform"]).max() / LENGTH
                    record.add(waves, kind, seed, [Figure(apart, "1 %", SHARE, far)])
                click.echo(f"{waves}: {kind}, start {seed + 1} of {starts}")
    for (kind, seed), errors in periods.items():
        record.add("sloshing, all these depths", kind, seed, over_depths(errors))
    record.add("collision of a fine and a coarse ball", "layered", 0, collision())
    RESULTS.mkdir(exist_ok=True)
    with open(RESULTS / "accuracy.csv", "w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(("case", "water", "start", "figure", "bound", "value"))
        for case, water, seed, f in record.rows:
            writer.writerow((case, water, seed, f.name, f.bound, f"{f.value:.6g}"))
    report = [heading("Errors of the projection method", arch)]
    report.append(f"Starts: {starts}. Median (least to most).\n")
    for case in dict.fromkeys(row[0] for row in record.rows):
        report += [f"## {case[0].upper()}{case[1:]}\n", record.table(case), ""]
    (RESULTS / "accuracy.md").write_text("\n".join(report))
    click.echo("\n".join(report))


if __name__ == "__main__":
    main()
