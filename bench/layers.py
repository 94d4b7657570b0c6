"""Layered water against uniform water of the same finest spacing: speed beside error.

python bench/layers.py [--rounds 16] [--seconds 0.25] [--arch cpu]

Both are the same solver at the same tolerances, in frames of 1/60 s, each as many steps as its own
bounds on the time step ask for. The pools come to rest and rest on, then rock near resonance till
waves break; all of them take turns.
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
from msph.fluid.adaptivity.bands import AdaptationParameters
from msph.fluid.external_forces import ExternalForces

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
# Rocking: angle [deg], period [s]; waves as long as two of these boxes swing in 1.13 to 1.2 s.
ANGLE, PERIOD = 4.0, 1.1
# What pools do while they are timed.
PHASES = RESTING, ROCKING = "at rest", "rocking"
# Steps between passes of adaptation; fixed layers are those that the start gave each depth.
ADAPTIVE, FIXED = AdaptationParameters().every, 10**9
LAYERED = ("fixed layers", "adaptive layers")
# Thin bands, a sheet or two each, as the thesis has them.
BAND = 0.5
# Rest before the rocking [s]: to come to it, and to read errors.
SETTLE, REST = 2.0, 1.0


class Phase:
    """What a pool did at rest or rocking: mean wall-clock time [s] of the frames of each round,
    passes of adaptation and all; steps; iterations of each frame's last step."""

    def __init__(self):
        self.walls: list[float] = []
        self.steps, self.iterations = 0, []

    def speed(self, percent: float = 50.0) -> float:
        """Simulated seconds per wall-clock second in the median round, or in the one that so many
        percent were faster than."""
        return tanks.FRAME / float(np.percentile(self.walls, percent))

    def frame(self) -> str:
        """Milliseconds a frame: median and quartiles of the rounds."""
        low, median, high = np.percentile(self.walls, (25, 50, 75)) * 1e3
        return f"{median:.1f} ({low:.1f} to {high:.1f})"


class Pool:
    """One pool, and its record."""

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
        self.seconds, self.phases = seconds, {phase: Phase() for phase in PHASES}

    def round(self, phase: str) -> None:
        """One timed round."""
        sim, record = self.simulation, self.phases[phase]
        steps, wall, frames = sim.steps, 0.0, round(self.seconds / tanks.FRAME)
        tilt = math.radians(ANGLE) if phase == ROCKING else 0.0
        for _ in range(frames):
            since = len(record.iterations) * tanks.FRAME
            angle = tilt * math.sin(2.0 * math.pi * since / PERIOD)
            g = tanks.GRAVITY
            forcing = ExternalForces(gravity=(g * math.sin(angle), -g * math.cos(angle), 0.0))
            ti.sync()
            begin = time.perf_counter()
            sim.advance(tanks.FRAME, forcing)
            ti.sync()
            wall += time.perf_counter() - begin
            record.iterations.append(sim.solver.iterations)
            self.reading.read()
        record.walls.append(wall / frames)
        record.steps += sim.steps - steps


def ratio(one: Phase, other: Phase) -> str:
    """How many times as fast one is as the other: by the median, and by the faster quarter."""
    return f"{one.speed() / other.speed():.2f} ({one.speed(25.0) / other.speed(25.0):.2f})"


def row(name: str, kind: str, pool: Pool) -> dict[str, str]:
    r, phases = pool.reading, pool.phases.values()
    return {
        "pool": name,
        "water": kind,
        "particles": f"{pool.simulation.particles.count:,}",
        **{f"ms a frame {phase}": record.frame() for phase, record in pool.phases.items()},
        "steps a frame": " / ".join(f"{p.steps / len(p.iterations):.2f}" for p in phases),
        "iterations a step": " / ".join(f"{np.mean(p.iterations):.1f}" for p in phases),
        "pressure error at rest, probes": f"{100 * pool.rest[0]:.2f} %",
        "particles in sheets": f"{100 * pool.rest[1]:.2f} %",
        "energy rise at rest": f"{100 * pool.rest[2]:.3f} %",
        "density error mean": f"{100 * np.mean(r.error_mean):.3f} %",
        "99th percentile": f"{100 * np.mean(r.error_p99):.2f} %",
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
        for kind, every in zip(LAYERED, (FIXED, ADAPTIVE), strict=True):
            pools[name, kind] = Pool(depth, layers, seconds, every)
        click.echo(f"{name} is at rest")
    for width, depths, layers in DOUBLING:
        for depth in depths:
            name = deep(depth, width)
            pools[name, LAYERED[0]] = Pool(depth, layers, seconds, FIXED, width)
            click.echo(f"{name} is at rest")
    for phase in PHASES:
        for _ in range(rounds):
            for pool in pools.values():
                pool.round(phase)
    rows = [row(name, kind, pool) for (name, kind), pool in pools.items()]
    ratios = []
    for phase in PHASES:
        records = {key: pool.phases[phase] for key, pool in pools.items()}
        for name, (_, _, target, thesis) in POOLS.items():
            shown = [ratio(records[name, kind], records[name, "uniform"]) for kind in LAYERED]
            ratios.append((f"{name}, {phase}", f">= {target:g}", *shown, f"{thesis or '-'}"))
        bound = f"<= {DOUBLING_TARGET}"
        costs = [ratio(records["pool", kind], records["pool_2x", kind]) for kind in LAYERED]
        ratios.append((f"cost of doubling pool to pool_2x, {phase}", bound, *costs, "-"))
        for width, depths, _ in DOUBLING:
            once, twice = (records[deep(depth, width), LAYERED[0]] for depth in depths)
            name = f"cost of doubling {depths[0] / DEPTH:.0f} times as deep, {width:g} m wide"
            ratios.append((f"{name}, {phase}", bound, ratio(once, twice), "", "-"))
    RESULTS.mkdir(exist_ok=True)
    with open(RESULTS / "layers.csv", "w", newline="") as file:
        writer = csv.DictWriter(file, rows[0].keys())
        writer.writeheader()
        writer.writerows(rows)
    report = [
        heading("Layered against uniform water", arch),
        "Finest particles of .1 kg in a pool of 1 m by 1 m, at rest and then rocked by "
        f"{ANGLE:g} degrees every {PERIOD:g} s, near resonance: till waves break. {rounds} rounds "
        f"of {seconds:g} s each, in turns, and their mean frames: median and quartiles. Ratios are "
        "of medians, in brackets of the faster quarters: others use the machine too.\n",
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
