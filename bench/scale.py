"""Layered against uniform water: pools of growing depth, and a cube of growing number of particles.

Both use the same solver and tolerances, in frames of 1/60 s with as many steps as the time step
limits require. "layers": pools of 1 m by 1 m, timed at rest, then rocking near resonance until
waves break. "scale": 1 m^3 of water at rest, with time and memory over the number of particles.
"""

import math
import statistics
from collections.abc import Callable
from functools import partial

import numpy as np

from bench import rows, tanks
from bench.tables import BETWEEN, Bench, Table, markdown
from msph.fluid.adaptivity.bands import AdaptationParameters, bands
from msph.fluid.external_forces import ExternalForces
from msph.fluid.particles.layers import LayerSpec
from msph.fluid.projection.solver import Projection
from msph.fluid.simulation import WORD, Simulation, footprint
from msph.measure.timings import peak_memory
from msph.scene.schema import Scene

UNIFORM, LAYERED = "uniform", "layered"
# Pools: the thesis's finest spacing [m], and depth of its smaller pool, filled by 2650 particles of
# 0.2 kg [m].
FINE, DEPTH = (0.1 / 1000.0) ** (1.0 / 3.0), 0.465
# Pools: depth [m], layers, target speed-up, the thesis's speed-up (Gokdogan 2008, table 5.1). In
# pool_2x a seventh layer saves no time and increases pressure errors by a quarter; in the deep pool
# six layers need two steps per frame, and seven or nine layers have twice the pressure error.
POOLS = {
    "pool": (DEPTH, 5, 4.0, 3.35),
    "pool_2x": (0.92, 6, 8.0, 5.8),
    "8 times as deep": (8 * DEPTH, 8, 30.0, None),
}
# Pools of single and double depth: width [m], depths over DEPTH, number of layers. The target is at
# most 10 % more time at double depth. The coarsest spacing fits at least three times into the
# width.
DOUBLING, DOUBLING_TARGET = ((1.0, (8, 16), 9), (2.0, (8, 16), 11)), 1.1
# Rocking: angle [deg], period [s]; the first sloshing mode has a period of 1.13 to 1.2 s.
ANGLE, PERIOD = 4.0, 1.1
# Tilt [rad] over time [s] of the phases that are timed, and their simulated time [s].
TILTS: dict[str, Callable[[float], float]] = {
    "at rest": lambda t: 0.0,
    "rocking": lambda t: math.radians(ANGLE) * math.sin(2.0 * math.pi * t / PERIOD),
}
PHASES, SECONDS = tuple(TILTS), 2.0
# Steps between passes of adaptation by kind of layers; fixed layers keep the initial layer of each
# particle.
KINDS = {"fixed layers": 10**9, "adaptive layers": AdaptationParameters().every}
# Band thickness in supports: one or two particles, as in the thesis.
BAND = 0.5
# Times before the timed phases [s]: to settle, and to measure errors at rest.
SETTLE, REST = 2.0, 1.0
# Frames between measurements of the kernel density error.
KERNEL_EVERY = 10

# Cube: edge [m], and numbers of particles along it.
EDGE, ALONG = 1.0, (10, 15, 22, 32, 46, 68, 100)
# Largest share of the depth (-) above the coarsest layer, which must be a few particles deep.
ABOVE_COARSEST = 0.8
# Capacity over the number of particles in the bands (-), as neighbouring bands overlap.
ROOM = 1.5
# Number of timed frames by kind of water: not every step has a pass of adaptation.
TIMED_FRAMES = {UNIFORM: 3, LAYERED: 8}
# Target of the memory per particle [bytes], neighbour list included.
TARGET_BYTES = 600
# Smallest number of particles for the fit of slopes; launches dominate the time of smaller runs.
FIT_FROM = 10_000


def timed(
    sim: Simulation,
    frames: int,
    tilt: Callable[[float], float] = TILTS["at rest"],
    read: Callable[[int], None] = lambda frame: None,
) -> list[float]:
    """Runs frames under gravity tilted by tilt(time) [rad], and read(frame) after each; returns
    their elapsed times [s]."""
    walls, g = [], tanks.GRAVITY
    for frame in range(frames):
        angle = tilt(frame * tanks.FRAME)
        forces = ExternalForces(gravity=(g * math.sin(angle), -g * math.cos(angle), 0.0))
        advance = partial(sim.advance, tanks.FRAME, forces)
        walls.append(1e-3 * tanks.milliseconds(advance))
        read(frame)
    return walls


def pool(width: float, depth: float, layers: int, every: int, start: int) -> dict[str, float]:
    """Returns the figures of a pool at rest and rocking; width, depth [m]; every: steps between
    passes of adaptation."""
    thin = {"band": BAND, "every": every} if layers > 1 else {}
    tank = tanks.tank((width, width), depth, FINE, layers, 0.4, seed=start, adaptation=thin)
    sim = tanks.build(tank)
    reading = tanks.Reading(sim)
    tanks.run(sim, SETTLE)
    profile = tanks.Profile(sim, reading.depth)
    tanks.run(sim, REST, reading, profile)
    found = {
        "pressure error at rest, probes": profile.error(),
        "particle means": reading.pressure_error(),
        "energy rise at rest": reading.energy_rise(),
    }
    kernel, iterations = [], []

    def read(frame: int) -> None:
        iterations.append(sim.solver.iterations)
        reading.read()
        if frame % KERNEL_EVERY == 0:
            error = reading.water.kernel_density()
            kernel.append((error.mean, error.p99))

    for phase in PHASES:
        steps = sim.steps
        iterations.clear()
        walls = timed(sim, round(SECONDS / tanks.FRAME), TILTS[phase], read)
        found |= {
            f"ms per frame, {phase}": 1e3 * statistics.median(walls),
            f"steps per frame, {phase}": (sim.steps - steps) / len(walls),
            f"iterations per step, {phase}": float(np.mean(iterations)),
        }
    mean, p99 = np.mean(kernel, axis=0)
    return {
        **found,
        "particles": sim.particles.count,
        "solver residual, mean": float(np.mean(reading.error_mean)),
        "99th percentile": float(np.mean(reading.error_p99)),
        "kernel density error, mean": float(mean),
        "99th percentile of it": float(p99),
        "height of the centre of mass": reading.volume_error(),
    }


def pools() -> dict[tuple[str, str], partial]:
    """Returns the pools by name and kind of water."""
    found = {}
    for name, (depth, layers, _, _) in POOLS.items():
        found[name, UNIFORM] = partial(pool, 1.0, depth, 1, 0)
        for kind, every in KINDS.items():
            found[name, kind] = partial(pool, 1.0, depth, layers, every)
    for width, depths, layers in DOUBLING:
        for times in depths:
            every = KINDS["fixed layers"]
            found[deep(times, width), "fixed layers"] = partial(
                pool, width, times * DEPTH, layers, every
            )
    return found


def deep(times: int, width: float) -> str:
    """Returns the name of a pool by its depth over DEPTH and its width [m]."""
    return f"{times} times as deep, {width:g} m wide"


def ratios(known: list[dict]) -> list[str]:
    """Returns the table of speed-ups: medians and ranges of the starts."""
    times = {
        (row["case"], row["start"], phase): float(row[f"ms per frame, {phase}"])
        for row in known
        for phase in PHASES
    }
    starts = dict.fromkeys(row["start"] for row in known)

    def ratio(phase: str, fast: tuple[str, str], slow: tuple[str, str]) -> str:
        both = [[(BETWEEN.join(case), k, phase) for case in (slow, fast)] for k in starts]
        found = [times[a] / times[b] for a, b in both if a in times and b in times]
        return rows.spread(found, ".2f") if found else "-"

    lines = []
    for phase in PHASES:
        for name, (_, _, target, thesis) in POOLS.items():
            gains = [ratio(phase, (name, kind), (name, UNIFORM)) for kind in KINDS]
            lines.append([f"{name}, {phase}", f">= {target:g}", *gains, f"{thesis or '-'}"])
        costs = [ratio(phase, ("pool", kind), ("pool_2x", kind)) for kind in KINDS]
        bound = f"<= {DOUBLING_TARGET}"
        lines.append([f"cost of doubling pool to pool_2x, {phase}", bound, *costs, "-"])
        for width, depths, _ in DOUBLING:
            once, twice = ((deep(times, width), "fixed layers") for times in depths)
            cost = ratio(phase, once, twice)
            lines.append([f"cost of doubling {once[0]}, {phase}", bound, cost, "", "-"])
    heads = ("speed-up of layered over uniform water", "target", "fixed", "adaptive", "thesis")
    table = markdown([dict(zip(heads, line, strict=True)) for line in lines])
    return ["## Speed-ups\n", table]


def specs_of(finest: float, layers: int) -> list[LayerSpec]:
    """Returns layers of mass ratio 2 with the finest spacing `finest` [m]."""
    mass = 1000.0 * finest**3
    return [LayerSpec(mass * 2**k, 1000.0, Projection.SMOOTHING) for k in range(layers)]


def layers_of(along: int) -> int:
    """Returns the largest number of layers whose bands leave room for the coarsest layer."""
    band, layers = AdaptationParameters().band, 2
    while bands(specs_of(EDGE / along, layers + 1), band)[-1][0] < ABOVE_COARSEST * EDGE:
        layers += 1
    return layers


def scene_of(kind: str, along: int, seed: int = 0) -> Scene:
    """Returns the scene of uniform water of along^3 particles, or of layers with that finest
    spacing."""
    finest = EDGE / along
    if kind == UNIFORM:
        return tanks.tank((EDGE, EDGE), EDGE, finest, 1, seed=seed)
    specs = specs_of(finest, layers_of(along))
    ends = bands(specs, AdaptationParameters().band)
    held = sum(
        EDGE**2 * (min(bottom, EDGE) - top) / spec.volume
        for spec, (top, bottom) in zip(specs, ends, strict=True)
    )
    room = {"capacity": math.ceil(ROOM * held)}
    return tanks.tank((EDGE, EDGE), EDGE, finest, len(specs), seed=seed, adaptation=room)


def run(kind: str, along: int, seed: int) -> dict[str, float]:
    """Runs a cube of water; returns its times and memory."""
    sim = tanks.build(scene_of(kind, along, seed))
    sim.warm_up(tanks.FRAME)
    timed(sim, 1)  # the first steps are short
    steps, iterations = sim.steps, sim.iterations
    walls = timed(sim, TIMED_FRAMES[kind])
    frame, steps = statistics.mean(walls), sim.steps - steps
    return {
        "particles": sim.particles.count,
        "layers": sim.layers.count,
        "ms per frame": 1e3 * frame,
        "least": 1e3 * min(walls),
        "largest": 1e3 * max(walls),
        "steps per frame": steps / len(walls),
        "iterations per step": (sim.iterations - iterations) / steps,
        "us per particle and frame": 1e6 * frame / sim.particles.count,
        "us per particle and step": 1e6 * frame * len(walls) / steps / sim.particles.count,
        **memory(sim),
        "process MiB": peak_memory() / 2**20,
    }


def memory(sim: Simulation) -> dict[str, float]:
    """Returns the bytes per particle of the capacity, by purpose, and the entries of the neighbour
    list per particle, allocated and used."""
    capacity, parameters = sim.particles.capacity, sim.solver.parameters
    words = footprint(sim.size, sim.layers.specs, capacity, parameters)
    neighbours, live = sim.solver.neighbours, sim.particles.count
    begin, end = (f.to_numpy()[:live] for f in (neighbours.start, neighbours.end))
    size = {purpose: WORD * n / capacity for purpose, n in words.items()}
    return {
        "bytes per particle": sum(size.values()),
        "attributes": size["particles"],
        "neighbour list": size["neighbours"],
        "cells": size["cells"],
        "entries allocated": neighbours.index.shape[0] / capacity,
        "used": float((end - begin).mean()),
    }


def slope(points: list[tuple[float, float]]) -> float:
    """Returns the exponent (-) of the power law fitted to points (x, y) with x >= FIT_FROM, or to
    all if there are fewer than two such points."""
    large = [(x, y) for x, y in points if x >= FIT_FROM]
    points = large if len(large) > 1 else points
    return float(np.polyfit(*np.log(np.array(points)).T, 1)[0]) if len(points) > 1 else math.nan


# Quantities of the table of slopes.
QUANTITIES = ("ms per frame", "us per particle and step", "bytes per particle", "process MiB")


def slopes(known: list[dict]) -> list[str]:
    """Returns the table of exponents over the fine-equivalent number of particles, by kind of water
    and device."""
    found: dict[str, list[tuple[float, dict]]] = {}
    for row in known:
        kind, fine = row["case"].split(BETWEEN)
        series = found.setdefault(f"{kind}, {row['table']}", [])
        series.append((float(fine.replace(",", "")), row))
    lines = []
    for name, series in found.items():
        line = {"water": name}
        for quantity in QUANTITIES:
            points = [(n, float(row[quantity])) for n, row in series if quantity in row]
            line |= {quantity: f"{slope(points):.2f}"} if points else {}
        lines.append(line)
    title = f"## Exponents over the fine-equivalent number, from {FIT_FROM:,} particles\n"
    return [title, markdown(lines)]


SCALE_FORMS = {
    "particles": ",.0f",
    "layers": ".0f",
    "ms per frame": ".3g",
    "least": ".3g",
    "largest": ".3g",
    "steps per frame": ".1f",
    "iterations per step": ".1f",
    "us per particle and frame": ".2f",
    "us per particle and step": ".2f",
    "bytes per particle": ",.0f",
    "attributes": ",.0f",
    "neighbour list": ",.0f",
    "cells": ",.0f",
    "entries allocated": ".0f",
    "used": ".0f",
    "process MiB": ",.0f",
}
POOL_FORMS = {
    "particles": ",.0f",
    **{f"ms per frame, {phase}": ".1f" for phase in PHASES},
    **{f"steps per frame, {phase}": ".2f" for phase in PHASES},
    **{f"iterations per step, {phase}": ".1f" for phase in PHASES},
    "pressure error at rest, probes": ".2%",
    "particle means": ".2%",
    "energy rise at rest": ".3%",
    "solver residual, mean": ".3%",
    "99th percentile": ".2%",
    "kernel density error, mean": ".2%",
    "99th percentile of it": ".2%",
    "height of the centre of mass": "+.2%",
}
BENCHES = {
    "layers": Bench(
        "Layered against uniform water",
        "Times are medians over frames; all figures are medians over the starts (least to "
        "largest).\n",
        {
            "pools": Table(
                "Pools of 1 m by 1 m with finest particles of 0.1 kg, at rest and then rocked by "
                f"{ANGLE:g} degrees with a period of {PERIOD:g} s, near resonance, until waves "
                f"break, {SECONDS:g} s each",
                ("pool", "water"),
                pools(),
                POOL_FORMS,
            )
        },
        ratios,
    ),
    "scale": Bench(
        "Cost and memory by the number of particles",
        "Fine-equivalent: number of particles of the finest layer that would fill the volume. "
        "Bytes: of the fields of particles,\nneighbour list and cells, per particle of the "
        f"capacity; an entry of the list takes {WORD * (1 + Projection.PER_ENTRY)}. Target: "
        f"{TARGET_BYTES} bytes per particle.\nProcess: peak memory on the host.\n",
        {
            arch: Table(
                f"{EDGE:g} m^3 of water at rest, {arch}: mean of {TIMED_FRAMES[UNIFORM]} frames, "
                f"{TIMED_FRAMES[LAYERED]} with layers, after the first frame",
                ("water", "fine-equivalent"),
                {
                    (kind, f"{along**3:,}"): partial(run, kind, along)
                    for along in ALONG
                    for kind in (UNIFORM, LAYERED)
                },
                SCALE_FORMS,
                starts=1,
                arch=arch,
            )
            for arch in ("cpu", "cuda", "vulkan")
        },
        slopes,
    ),
}
