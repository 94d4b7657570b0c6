"""Speed and errors of layered water against uniform water of the same finest spacing.

python bench/layers.py [--rounds 16] [--seconds 0.25] [--arch cpu]

Both use the same solver and tolerances, in frames of 1/60 s with as many steps as the time step
limits require. The pools are timed at rest, then rocking near resonance until waves break; all
pools run in alternating rounds.
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
# Depth of the thesis's smaller pool, filled by 2650 particles of 0.2 kg [m].
DEPTH = 0.465
# Pools: depth [m], layers, target speed-up, the thesis's speed-up (Gokdogan 2008, table 5.1). In
# pool_2x a seventh layer saves no time and increases pressure errors by a quarter; in the deep pool
# six layers need two steps per frame, and seven or nine layers have twice the pressure error.
POOLS = {
    "pool": (DEPTH, 5, 4.0, 3.35),
    "pool_2x": (0.92, 6, 8.0, 5.8),
    "8 times as deep": (8 * DEPTH, 8, 30.0, None),
}
# Pools of single and double depth: width [m], depths [m], number of layers. The target is at most
# 10 % more time at double depth. The coarsest spacing fits at least three times into the width.
DOUBLING = ((1.0, (8 * DEPTH, 16 * DEPTH), 9), (2.0, (8 * DEPTH, 16 * DEPTH), 11))
DOUBLING_TARGET = 1.1
# Rocking: angle [deg], period [s]; the first sloshing mode has a period of 1.13 to 1.2 s.
ANGLE, PERIOD = 4.0, 1.1
# Phases that are timed.
PHASES = RESTING, ROCKING = "at rest", "rocking"
# Steps between passes of adaptation; fixed layers keep the initial layer of each particle.
ADAPTIVE, FIXED = AdaptationParameters().every, 10**9
LAYERED = ("fixed layers", "adaptive layers")
# Band thickness in supports: one or two particles, as in the thesis.
BAND = 0.5
# Times before the timed rounds [s]: to settle, and to measure errors at rest.
SETTLE, REST = 2.0, 1.0


class Phase:
    """Record of a pool at rest or rocking: mean elapsed time per frame [s] of each round,
    adaptation included; number of steps; iterations of the last step of each frame."""

    def __init__(self):
        self.walls: list[float] = []
        self.steps, self.iterations = 0, []

    def speed(self, percent: float = 50.0) -> float:
        """Returns the real-time factor (-) at the median, or at another percentile, of the rounds'
        elapsed times."""
        return tanks.FRAME / float(np.percentile(self.walls, percent))

    def frame(self) -> str:
        """Returns the elapsed time per frame [ms]: median and quartiles of the rounds."""
        low, median, high = np.percentile(self.walls, (25, 50, 75)) * 1e3
        return f"{median:.1f} ({low:.1f} to {high:.1f})"


class Pool:
    """A pool and its record."""

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
        """Runs a timed round."""
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
    """Returns the speed-up of `one` over `other`: by medians, and by lower quartiles of the
    times."""
    return f"{one.speed() / other.speed():.2f} ({one.speed(25.0) / other.speed(25.0):.2f})"


def row(name: str, kind: str, pool: Pool) -> dict[str, str]:
    """Returns the table row of a pool."""
    r, phases = pool.reading, pool.phases.values()
    return {
        "pool": name,
        "water": kind,
        "particles": f"{pool.simulation.particles.count:,}",
        **{f"ms per frame, {phase}": record.frame() for phase, record in pool.phases.items()},
        "steps per frame": " / ".join(f"{p.steps / len(p.iterations):.2f}" for p in phases),
        "iterations per step": " / ".join(f"{np.mean(p.iterations):.1f}" for p in phases),
        "pressure error at rest, probes": f"{100 * pool.rest[0]:.2f} %",
        "particle means": f"{100 * pool.rest[1]:.2f} %",
        "energy rise at rest": f"{100 * pool.rest[2]:.3f} %",
        "solver residual, mean": f"{100 * np.mean(r.error_mean):.3f} %",
        "99th percentile": f"{100 * np.mean(r.error_p99):.2f} %",
        "largest": f"{100 * max(r.error_max):.2f} %",
        "height of the centre of mass": f"{100 * r.volume_error():+.2f} %",
    }


def deep(depth: float, width: float) -> str:
    """Returns the name of a pool by its depth and width [m]."""
    return f"{depth / DEPTH:.0f} times as deep, {width:g} m wide"


@click.command()
@click.option(
    "--rounds",
    default=16,
    show_default=True,
    type=click.IntRange(min=1),
    help="Number of rounds in each phase.",
)
@click.option("--seconds", default=0.25, show_default=True, help="Simulated time of a round [s].")
@click.option("--arch", type=click.Choice(ARCHES), default="auto", show_default=True)
def main(rounds: int, seconds: float, arch: str) -> None:
    """Measure speed and errors, and write bench/results/layers.{md,csv}."""
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
        "Pools of 1 m by 1 m with finest particles of 0.1 kg, at rest and then rocked by "
        f"{ANGLE:g} degrees with a period of {PERIOD:g} s, near resonance, until waves break. "
        f"{rounds} alternating rounds of {seconds:g} s each: median and quartiles of their mean "
        "time per frame. Ratios are of medians, in brackets of lower quartiles, which other "
        "processes on the machine disturb less.\n",
        tabulate(
            ratios,
            (
                "speed-up of layered over uniform water",
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
