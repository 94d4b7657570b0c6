"""Layered water against uniform water of the same finest spacing: speed beside error.

python bench/layers.py [--rounds 16] [--seconds 0.25] [--arch cpu]

Both are the same solver at the same tolerances, in frames of 1/60 s, each as many steps as its own
bounds on the time step ask for. The pools come to rest, then rock; all of them take turns.
"""

import csv
import math
import sys
import time
from pathlib import Path

import click
import numpy as np
import taichi as ti
from tabulate import tabulate

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from bench import tanks
from bench.report import RESULTS, heading
from msph.device import ARCHES, start
from msph.fluid.adaptation import AdaptationTerms
from msph.fluid.forcing import Forcing

# The thesis's finest mass in a pool of 1 m by 1 m.
FINE = (0.1 / 1000.0) ** (1.0 / 3.0)
# Depth of the thesis's smaller pool, filled by 2650 particles of .2 kg [m].
DEPTH = 0.465
# Pools: depth [m], layers, target ratio, the thesis's ratio (Gokdogan 2008, table 5.1). In pool_2x
# a seventh layer saves no time, and its few particles make pressures a quarter worse; in the deep
# pool six need two steps a frame, and with seven or nine pressures are twice as far off.
POOLS = {
    "pool": (DEPTH, 5, 4.0, 3.35),
    "pool_2x": (0.92, 6, 8.0, 5.8),
    "8 times as deep": (8 * DEPTH, 8, 30.0, None),
}
# Pools whose costs are compared: width [m], depths [m], layers of each. Doubling may add a tenth.
# What is added is coarse, in layers whose spacings fit at least three times into the width.
DOUBLING = ((1.0, (8 * DEPTH, 16 * DEPTH), 9), (2.0, (8 * DEPTH, 16 * DEPTH), 11))
DOUBLING_TARGET = 1.1
# Rocking: angle [deg], period [s].
ANGLE, PERIOD = 4.0, 1.1
# Steps between passes of adaptation; fixed layers are those that the start gave each depth.
ADAPTIVE, FIXED = AdaptationTerms().every, 10**9
# Thin bands, a sheet or two each, as the thesis has them.
BAND = 0.5
# Rest before the rocking [s]: to come to it, and to read errors.
SETTLE, REST = 2.0, 1.0


class Pool:
    """One pool and its record: mean wall-clock time [s] of the frames of each round, passes of
    adaptation and all."""

    def __init__(
        self,
        depth: float,
        layers: int,
        seconds: float,
        every: int = ADAPTIVE,
        width: float = 1.0,
    ):
        extra = {"band": BAND, "every": every} if layers > 1 else {}
        scene = tanks.tank((width, width), depth, FINE, layers, 0.4, **extra)
        self.simulation = tanks.build(scene)
        self.reading = tanks.Reading(self.simulation)
        tanks.run(self.simulation, SETTLE)
        profile = tanks.Profile(self.simulation, self.reading.depth)
        tanks.run(self.simulation, REST, self.reading, profile)
        self.rest = profile.error(), self.reading.pressure_error(), self.reading.energy_rise()
        self.seconds, self.walls, self.steps, self.iterations = seconds, [], 0, []

    def rock(self) -> None:
        """One timed round."""
        sim = self.simulation
        steps, wall, frames = sim.steps, 0.0, round(self.seconds / tanks.FRAME)
        for _ in range(frames):
            swing = 2.0 * math.pi * (sim.time - SETTLE - REST) / PERIOD
            angle = math.radians(ANGLE) * math.sin(swing)
            g = tanks.GRAVITY
            forcing = Forcing(gravity=(g * math.sin(angle), -g * math.cos(angle), 0.0))
            ti.sync()
            begin = time.perf_counter()
            sim.advance(tanks.FRAME, forcing)
            ti.sync()
            wall += time.perf_counter() - begin
            self.iterations.append(sim.solver.iterations)
            self.reading.read()
        self.walls.append(wall / frames)
        self.steps += sim.steps - steps

    def speed(self, percent: float = 50.0) -> float:
        """Simulated seconds per wall-clock second in the median round, or in the one that so many
        percent were faster than."""
        return tanks.FRAME / float(np.percentile(self.walls, percent))


def ratio(one: Pool, other: Pool) -> str:
    """How many times as fast one is as the other: by the median, and by the faster quarter."""
    return f"{one.speed() / other.speed():.2f} ({one.speed(25.0) / other.speed(25.0):.2f})"


def row(name: str, kind: str, pool: Pool) -> dict[str, str]:
    r = pool.reading
    quartiles = np.percentile(pool.walls, (25, 50, 75)) * 1e3
    return {
        "pool": name,
        "water": kind,
        "particles": f"{pool.simulation.particles.count:,}",
        "ms a frame": f"{quartiles[1]:.1f} ({quartiles[0]:.1f} to {quartiles[2]:.1f})",
        "simulated s/s": f"{pool.speed():.3g}",
        "steps a frame": f"{pool.steps / len(pool.iterations):.2f}",
        "iterations a step": f"{np.mean(pool.iterations):.1f}",
        "pressure error at rest, probes": f"{100 * pool.rest[0]:.2f} %",
        "particles in sheets": f"{100 * pool.rest[1]:.2f} %",
        "energy rise at rest": f"{100 * pool.rest[2]:.3f} %",
        "density error mean": f"{100 * np.mean(r.error_mean):.3f} %",
        "largest": f"{100 * max(r.error_max):.2f} %",
        "height of the centre": f"{100 * r.volume_error():+.2f} %",
    }


def deep(depth: float, width: float) -> str:
    """Name of a pool by its depth and width [m]."""
    return f"{depth / DEPTH:.0f} times as deep, {width:g} m wide"


@click.command()
@click.option("--rounds", default=16, show_default=True, type=click.IntRange(min=1))
@click.option("--seconds", default=0.25, show_default=True, help="Simulated time of a round.")
@click.option("--arch", type=click.Choice(ARCHES), default="auto", show_default=True)
def main(rounds: int, seconds: float, arch: str) -> None:
    """Measure and write bench/results/layers.{md,csv}."""
    arch = start(arch)
    pools: dict[tuple[str, str], Pool] = {}
    for name, (depth, layers, _, _) in POOLS.items():
        pools[name, "uniform"] = Pool(depth, 1, seconds)
        pools[name, "fixed layers"] = Pool(depth, layers, seconds, FIXED)
        pools[name, "adaptive layers"] = Pool(depth, layers, seconds)
        click.echo(f"{name} is at rest")
    for width, depths, layers in DOUBLING:
        for depth in depths:
            name = deep(depth, width)
            pools[name, "fixed layers"] = Pool(depth, layers, seconds, FIXED, width)
            click.echo(f"{name} is at rest")
    for _ in range(rounds):
        for pool in pools.values():
            pool.rock()
    rows = [row(name, kind, pool) for (name, kind), pool in pools.items()]
    ratios = []
    for name, (_, _, target, thesis) in POOLS.items():
        uniform, *layered = (pool for (own, _), pool in pools.items() if own == name)
        shown = [ratio(pool, uniform) for pool in layered]
        ratios.append((name, f">= {target:g}", *shown, f"{thesis or '-'}"))
    bound = f"<= {DOUBLING_TARGET}"
    costs = [
        ratio(pools["pool", kind], pools["pool_2x", kind])
        for kind in ("fixed layers", "adaptive layers")
    ]
    ratios.append(("cost of doubling pool to pool_2x", bound, *costs, "-"))
    for width, depths, _ in DOUBLING:
        once, twice = (pools[deep(depth, width), "fixed layers"] for depth in depths)
        name = f"cost of doubling {depths[0] / DEPTH:.0f} times as deep, {width:g} m wide"
        ratios.append((name, bound, ratio(once, twice), "", "-"))
    RESULTS.mkdir(exist_ok=True)
    with open(RESULTS / "layers.csv", "w", newline="") as file:
        writer = csv.DictWriter(file, rows[0].keys())
        writer.writeheader()
        writer.writerows(rows)
    report = [
        heading("Layered against uniform water", arch),
        f"Finest particles of .1 kg in a pool of 1 m by 1 m, rocked by {ANGLE:g} degrees; {rounds} "
        f"rounds of {seconds:g} s in turns, and their mean frames: median and quartiles. Ratios "
        "are of medians, in brackets of the faster quarters: others use the machine too.\n",
        tabulate(
            ratios,
            (
                "simulated time a second, layered over uniform",
                "target",
                "fixed",
                "adaptive",
                "thesis",
            ),
            tablefmt="github",
            disable_numparse=True,
        ),
        "",
        tabulate(rows, headers="keys", tablefmt="github", disable_numparse=True),
        "",
    ]
    (RESULTS / "layers.md").write_text("\n".join(report))
    click.echo("\n".join(report))


if __name__ == "__main__":
    main()
