"""Errors of the projection method against formulas, uniform and layered alike.

python bench/accuracy.py [--seconds 10] [--arch cpu]
"""

import csv
import sys
from pathlib import Path

import click
import numpy as np
from tabulate import tabulate

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from bench import tanks
from bench.report import RESULTS, heading
from msph.device import ARCHES, start
from msph.fluid.adaptation import AdaptationTerms
from msph.fluid.forcing import Forcing
from msph.fluid.layers import LayerSpec
from msph.fluid.projection_terms import ProjectionTerms
from msph.fluid.simulation import Simulation
from msph.scene.water import SMOOTHING

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
# Sloshing: box length and depth [m], amplitude as a share of the depth, fine spacings per depth.
LENGTH, DEPTH, AMPLITUDE, SPACINGS = 1.0, 0.5, 0.05, (15, 20)
SLOSH_SECONDS = 5.0


def still(kind: str, seconds: float) -> list[tuple[str, str, str]]:
    """Rows (figure, target, measured) of water that should stay where it is."""
    layers, changes = WATERS[kind]
    scene = tanks.tank((10 * FINE, 10 * FINE), SHEETS_DEEP * FINE, FINE, layers, **changes)
    sim = tanks.build(scene)
    reading = tanks.Reading(sim)
    reading.read()
    tanks.run(sim, 1.0, reading)
    changed = np.array(sim.counts())
    later, profile = tanks.Reading(sim), tanks.Profile(sim, reading.depth)
    tanks.run(sim, seconds - 1.0, later, profile)
    changed = int(np.abs(changed - sim.counts()).sum())
    frames = round(1.0 / tanks.FRAME)
    kinetic = [
        float(np.mean(part)) for part in (reading.kinetic[-frames:], later.kinetic[-frames:])
    ]
    rise = max(reading.energy_rise(), later.energy_rise())
    profiled = "pressure against rho g (H - y), rms over depth"
    return [
        ("particles", "", f"{sim.particles.count:,}"),
        (f"{profiled}, of probes", "2 %", percent(profile.error())),
        (f"{profiled}, of particles in sheets", "2 %", percent(later.pressure_error())),
        ("density error, mean", ".2 %", percent(float(np.mean(later.error_mean)))),
        ("density error, largest", "2 %", percent(max(later.error_max))),
        ("height of the centre against rest", "1 %", percent(later.volume_error())),
        ("energy, largest rise in 1 s", ".1 %", percent(rise)),
        ("kinetic energy, first and last second, J", "decays", "{:.3g}, {:.3g}".format(*kinetic)),
        (f"particles that changed layer in {seconds - 1:g} s", "", f"{changed}"),
    ]


def sloshing(kind: str, spacings: int) -> tuple[list[tuple[str, str, str]], np.ndarray]:
    """Rows of a sloshing tank, and the way of its centre of mass along the box [m]."""
    fine = DEPTH / spacings
    layers, changes = WATERS[kind]
    sim = tanks.build(tanks.tank((LENGTH, 10 * fine), DEPTH, fine, layers, **changes))
    tanks.run(sim, 1.0)
    tanks.slosh(sim, DEPTH, AMPLITUDE * DEPTH)
    reading = tanks.Reading(sim)
    tanks.run(sim, SLOSH_SECONDS, reading)
    x = np.array(reading.centres)[:, 0]
    theory = tanks.slosh_period(LENGTH, DEPTH)
    found = tanks.fitted_period([t - 1.0 for t in reading.times], x, theory)
    rows = [
        ("particles", "", f"{sim.particles.count:,}"),
        (f"period against linear theory, {theory:.3f} s", "1 %", percent(found / theory - 1.0)),
        ("density error, mean", "", percent(float(np.mean(reading.error_mean)))),
        ("density error, largest", "", percent(max(reading.error_max))),
        ("energy, largest rise in 1 s", ".1 %", percent(reading.energy_rise())),
        ("height of the centre against rest", "1 %", percent(reading.volume_error())),
    ]
    return rows, x


def collision() -> list[tuple[str, str, str]]:
    """Rows of two blobs that collide without gravity, off centre, splits and merges on."""
    d, middle, radius = 0.025, 1.2, 0.15
    specs = [LayerSpec(1000.0 * d**3 * 2**k, 1000.0, SMOOTHING["projection"]) for k in range(3)]
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
    terms = ProjectionTerms(adaptation=AdaptationTerms(band=0.7, every=2))
    sim = Simulation((2.4, 2.4, 2.4), specs, {"x": x, "v": v, "layer": layer}, terms, capacity=5000)

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
            sim.advance(tanks.FRAME, Forcing(gravity=(0.0, 0.0, 0.0)))
    after = set(sim.particles.numpy("id"))
    mass_after, linear_after, angular_after, _ = momenta()
    drift = np.linalg.norm(linear_after - linear) / scale
    turned = np.linalg.norm(angular_after - angular) / spin
    return [
        ("particles born, gone", "", f"{len(after - before)}, {len(before - after)}"),
        ("mass drift", "0", f"{abs(mass_after / mass - 1.0):.1e}"),
        ("momentum drift over sum m v", "1e-05", f"{drift:.1e}"),
        ("angular momentum drift over sum m r v", "1e-04", f"{turned:.1e}"),
    ]


def percent(share: float) -> str:
    return f"{100.0 * share:.3f} %"


@click.command()
@click.option("--seconds", default=10.0, show_default=True, help="Simulated time of still water.")
@click.option("--arch", type=click.Choice(ARCHES), default="auto", show_default=True)
def main(seconds: float, arch: str) -> None:
    """Measure and write bench/results/accuracy.{md,csv}."""
    arch = start(arch)
    rows: list[tuple[str, str, str, str, str]] = []
    depth = f"still water, {SHEETS_DEEP} fine spacings deep, {seconds:g} s"
    for kind in WATERS:
        rows += [(depth, kind, *r) for r in still(kind, seconds)]
    for spacings in SPACINGS:
        waves = f"sloshing, amplitude {AMPLITUDE:.0%} of the depth, {spacings} spacings deep"
        centres = {}
        for kind in WATERS:
            found, centres[kind] = sloshing(kind, spacings)
            rows += [(waves, kind, *r) for r in found]
        apart = np.abs(centres["layered"] - centres["uniform"]).max() / LENGTH
        text = f"centre of mass, layered from uniform, most in {SLOSH_SECONDS:g} s, over the length"
        rows.append((waves, "both", text, "1 %", percent(apart)))
    rows += [("collision of a fine and a coarse ball", "layered", *r) for r in collision()]
    headers = ("case", "water", "figure", "bound", "measured")
    RESULTS.mkdir(exist_ok=True)
    with open(RESULTS / "accuracy.csv", "w", newline="") as file:
        csv.writer(file).writerows([headers, *rows])
    report = [heading("Errors of the projection method", arch)]
    for case in dict.fromkeys(r[0] for r in rows):
        own = [r[1:] for r in rows if r[0] == case]
        table = tabulate(own, headers[1:], tablefmt="github", disable_numparse=True)
        report += [f"## {case[0].upper()}{case[1:]}\n", table, ""]
    (RESULTS / "accuracy.md").write_text("\n".join(report))
    click.echo("\n".join(report))


if __name__ == "__main__":
    main()
