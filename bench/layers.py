"""Speed and errors of layered water against uniform water of the same finest spacing.

python bench/layers.py [--seconds 2] [--starts 3] [--only pool] [--resume] [--arch cpu]

Both use the same solver and tolerances, in frames of 1/60 s with as many steps as the time step
limits require. The pools are timed at rest, then rocking near resonance until waves break. Each
pool is a process, from several starts, and is written to bench/results/layers.csv when it ends;
all pools of a start run before the next start. --resume continues there.
"""

import json
import math
import statistics
import sys
import time
from pathlib import Path

import click
import numpy as np
import taichi as ti
from tabulate import tabulate

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from bench import rows, tanks
from bench.report import RESULTS, heading
from msph.device import ARCHES, start
from msph.fluid.adaptivity.bands import AdaptationParameters
from msph.fluid.external_forces import ExternalForces
from msph.measure.kernel_density import kernel_density

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
# Times before the timed phases [s]: to settle, and to measure errors at rest.
SETTLE, REST = 2.0, 1.0
# Time limit of a pool [s].
MAX_SECONDS = 3600
TABLE = "layers.csv"
# Frames between measurements of the kernel density error.
KERNEL_EVERY = 10


# Figures of a pool: head of the table and format.
FIGURES = {
    "particles": ("particles", "{:,.0f}"),
    **{f"ms_{phase}": (f"ms per frame, {phase}", "{:.1f}") for phase in PHASES},
    **{f"steps_{phase}": (f"steps per frame, {phase}", "{:.2f}") for phase in PHASES},
    **{f"iterations_{phase}": (f"iterations per step, {phase}", "{:.1f}") for phase in PHASES},
    "pressure_probes": ("pressure error at rest, probes", "{:.2%}"),
    "pressure_particles": ("particle means", "{:.2%}"),
    "energy_rise": ("energy rise at rest", "{:.3%}"),
    "solver_residual_mean": ("solver residual, mean", "{:.3%}"),
    "solver_residual_p99": ("99th percentile", "{:.2%}"),
    "kernel_density_error_mean": ("kernel density error, mean", "{:.2%}"),
    "kernel_density_error_p99": ("99th percentile of it", "{:.2%}"),
    "height": ("height of the centre of mass", "{:+.2%}"),
}


def pools() -> list[tuple[str, str, float, float, int, int]]:
    """Returns the pools: name, kind of water, width and depth [m], number of layers, and steps
    between passes of adaptation."""
    found = []
    for name, (depth, layers, _, _) in POOLS.items():
        found.append((name, "uniform", 1.0, depth, 1, ADAPTIVE))
        for kind, every in zip(LAYERED, (FIXED, ADAPTIVE), strict=True):
            found.append((name, kind, 1.0, depth, layers, every))
    for width, depths, layers in DOUBLING:
        found += [(deep(d, width), LAYERED[0], width, d, layers, FIXED) for d in depths]
    return found


def pool(
    width: float, depth: float, layers: int, every: int, start: int, seconds: float
) -> dict[str, float]:
    """Returns the figures of a pool at rest and rocking, of `seconds` [s] each."""
    extra = {"band": BAND, "every": every} if layers > 1 else {}
    scene = tanks.tank((width, width), depth, FINE, layers, 0.4, seed=start, **extra)
    sim = tanks.build(scene)
    reading = tanks.Reading(sim)
    tanks.run(sim, SETTLE)
    profile = tanks.Profile(sim, reading.depth)
    tanks.run(sim, REST, reading, profile)
    found = {
        "pressure_probes": profile.error(),
        "pressure_particles": reading.pressure_error(),
        "energy_rise": reading.energy_rise(),
    }
    kernel = []
    for phase in PHASES:
        tilt = math.radians(ANGLE) if phase == ROCKING else 0.0
        steps, walls, iterations = sim.steps, [], []
        for frame in range(round(seconds / tanks.FRAME)):
            angle = tilt * math.sin(2.0 * math.pi * frame * tanks.FRAME / PERIOD)
            g = tanks.GRAVITY
            forcing = ExternalForces(gravity=(g * math.sin(angle), -g * math.cos(angle), 0.0))
            ti.sync()
            begin = time.perf_counter()
            sim.advance(tanks.FRAME, forcing)
            ti.sync()
            walls.append(time.perf_counter() - begin)
            iterations.append(sim.solver.iterations)
            reading.read()
            if frame % KERNEL_EVERY == 0:
                water = reading.water
                error = kernel_density(water.positions(), water.spacings(), water.size)
                kernel.append((error.mean, error.p99))
        found |= {
            f"ms_{phase}": 1e3 * statistics.median(walls),
            f"steps_{phase}": (sim.steps - steps) / len(walls),
            f"iterations_{phase}": float(np.mean(iterations)),
        }
    mean, p99 = np.mean(kernel, axis=0)
    return {
        **found,
        "particles": sim.particles.count,
        "solver_residual_mean": float(np.mean(reading.error_mean)),
        "solver_residual_p99": float(np.mean(reading.error_p99)),
        "kernel_density_error_mean": float(mean),
        "kernel_density_error_p99": float(p99),
        "height": reading.volume_error(),
    }


def deep(depth: float, width: float) -> str:
    """Returns the name of a pool by its depth and width [m]."""
    return f"{depth / DEPTH:.0f} times as deep, {width:g} m wide"


def of(known: list[dict], name: str, kind: str) -> dict[str, dict]:
    """Returns the rows of a pool by start."""
    return {str(r["start"]): r for r in known if (r["pool"], r["water"]) == (name, kind)}


def ratio(known: list[dict], phase: str, one: tuple[str, str], other: tuple[str, str]) -> str:
    """Returns the speed-up of pool `one` over the `other`: median and range of the starts."""
    fast, slow = of(known, *one), of(known, *other)
    key = f"ms_{phase}"
    found = [float(slow[k][key]) / float(fast[k][key]) for k in fast if k in slow]
    return rows.spread(found, "{:.2f}") if found else "-"


def ratios(known: list[dict]) -> list[tuple[str, ...]]:
    """Returns the rows of the table of speed-ups."""
    found = []
    for phase in PHASES:
        for name, (_, _, target, thesis) in POOLS.items():
            shown = [ratio(known, phase, (name, kind), (name, "uniform")) for kind in LAYERED]
            found.append((f"{name}, {phase}", f">= {target:g}", *shown, f"{thesis or '-'}"))
        bound = f"<= {DOUBLING_TARGET}"
        costs = [ratio(known, phase, ("pool", kind), ("pool_2x", kind)) for kind in LAYERED]
        found.append((f"cost of doubling pool to pool_2x, {phase}", bound, *costs, "-"))
        for width, depths, _ in DOUBLING:
            once, twice = ((deep(depth, width), LAYERED[0]) for depth in depths)
            name = f"cost of doubling {depths[0] / DEPTH:.0f} times as deep, {width:g} m wide"
            cost = ratio(known, phase, once, twice)
            found.append((f"{name}, {phase}", bound, cost, "", "-"))
    return found


def report(known: list[dict], seconds: float, arch: str) -> str:
    """Returns the report of the rows."""
    lines = []
    for name, kind, *_ in pools():
        own = list(of(known, name, kind).values())
        if own:
            cells = {
                head: rows.spread([float(r[key]) for r in own], form)
                for key, (head, form) in FIGURES.items()
            }
            lines.append({"pool": name, "water": kind, "starts": str(len(own)), **cells})
    heads = ("speed-up of layered over uniform water", "target", "fixed", "adaptive", "thesis")
    return "\n".join(
        [
            heading("Layered against uniform water", arch),
            "Pools of 1 m by 1 m with finest particles of 0.1 kg, at rest and then rocked by "
            f"{ANGLE:g} degrees with a period of {PERIOD:g} s, near resonance, until waves break, "
            f"{seconds:g} s each. Times are medians over frames; all figures are medians over the "
            "starts (least to largest).\n",
            tabulate(ratios(known), heads, tablefmt="github", disable_numparse=True),
            "",
            tabulate(lines, headers="keys", tablefmt="github", disable_numparse=True),
            "",
        ]
    )


@click.command()
@click.option("--seconds", default=2.0, show_default=True, help="Simulated time of a phase [s].")
@click.option(
    "--starts", default=rows.STARTS, show_default=True, type=click.IntRange(1), help="Starts."
)
@click.option("--only", multiple=True, help="Name of a pool to run. Repeatable.")
@click.option("--resume", is_flag=True, help="Keep the rows of earlier runs.")
@click.option("--arch", type=click.Choice(ARCHES), default="auto", show_default=True)
@click.option("--worker", hidden=True)
def main(seconds: float, starts: int, only, resume: bool, arch: str, worker: str | None) -> None:
    """Measure speed and errors, and write bench/results/layers.{md,csv}."""
    arch = start(arch)
    if worker:
        print(json.dumps(pool(*json.loads(worker))))
        return
    known: list[dict] = rows.read(RESULTS / TABLE) if resume or only else []
    for seed in range(starts):
        for name, kind, *numbers in pools():
            if (only and name not in only) or str(seed) in of(known, name, kind):
                continue
            found = rows.in_process(__file__, (*numbers, seed, seconds), MAX_SECONDS)
            click.echo(f"{name}, {kind}, start {seed + 1} of {starts} {found.get('failure', '')}")
            if "failure" not in found:
                known.append({"pool": name, "water": kind, "start": seed, **found})
                rows.write(RESULTS / TABLE, known)
    text = report(known, seconds, arch)
    (RESULTS / "layers.md").write_text(text)
    click.echo(text)


if __name__ == "__main__":
    main()
