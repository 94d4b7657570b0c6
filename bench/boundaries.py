"""Inflows and outflows against theory; writes bench/results/boundaries.md.

python bench/boundaries.py [--arch cpu]
"""

import math
import sys
from pathlib import Path
from typing import Any

import click
import numpy as np
from tabulate import tabulate

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from bench import floating, tanks
from bench.report import RESULTS, heading
from msph.device import start
from msph.fluid.external_forces import ExternalForces
from msph.fluid.simulation import Simulation
from msph.scene.schema import Scene

STILL = ExternalForces((0.0, -tanks.GRAVITY, 0.0))
# Contraction of a plane jet from a sharp-edged slit (Kirchhoff 1869).
CONTRACTION = math.pi / (math.pi + 2.0)
# Emptied tank: length, depth, spacing and width of the slit in the floor [m]; levels [m] between
# which it is timed, and depth [m] below the floor from which on the jet's speed is measured.
LENGTH, DEEP, FINE, SLIT = 0.5, 0.3, 0.0125, 0.075
LEVELS, BELOW = (0.28, 0.12), 0.9 * SLIT
# Basin: edge, depth and spacing [m]; radius [m] and speed [m/s] of the spring.
EDGE, DEPTH, SPACING, RADIUS, SPEED = 0.3, 0.15, 0.025, 0.05, 0.3
# Vertical jet: radius [m], speed [m/s], time [s] in which the particles enter that are followed.
JET_RADIUS, JET_SPEED, FOLLOWED = 0.05, 3.0, 0.05


def build(scene: Scene, openings: dict[str, Any]) -> Simulation:
    """Returns the simulation of a tank with inflows and outflows."""
    return tanks.build(Scene.model_validate({**scene.model_dump(), **openings}))


def inside(sim: Simulation) -> np.ndarray:
    """Returns the heights [m] of the particles in the box."""
    y = sim.particles.numpy("x")[:, 1].astype(float)
    return y[y > 0.0]


def drained(seed: int) -> dict[str, float]:
    """A tank that empties through a slit: speed over sqrt(2 g h), h from the level to the place of
    the particles, in the mean; time over the one of theory with the contraction of the jet."""
    middle = 0.5 * LENGTH
    hole = {"lo": [middle - SLIT / 2, 0, 0], "hi": [middle + SLIT / 2, 0, SLIT]}
    scene = tanks.tank((LENGTH, SLIT), DEEP, FINE, 1, seed=seed)
    sim = build(scene, {"outflows": [hole]})
    spec, levels, times, ratios = sim.layers.specs[0], [], [], []
    while not levels or levels[-1] > LEVELS[1]:
        sim.advance(tanks.FRAME, STILL)
        x, v = sim.particles.numpy("x"), sim.particles.numpy("v")
        level = len(inside(sim)) * spec.volume / (LENGTH * SLIT)
        levels.append(level)
        times.append(sim.time)
        jet = x[:, 1] < -BELOW
        if level < LEVELS[0] and jet.any():
            speeds = np.linalg.norm(v[jet], axis=1) / np.sqrt(
                2.0 * tanks.GRAVITY * (level - x[jet, 1])
            )
            ratios.append(float(speeds.mean()))
    taken = np.interp([-h for h in LEVELS], [-h for h in levels], times)
    fall = math.sqrt(LEVELS[0]) - math.sqrt(LEVELS[1])
    theory = LENGTH / (CONTRACTION * SLIT) * math.sqrt(2.0 / tanks.GRAVITY) * fall
    sim.close()
    return {
        "speed / sqrt(2 g h) - 1": float(np.mean(ratios)) - 1.0,
        "draining time / theory - 1": float(taken[1] - taken[0]) / theory - 1.0,
    }


def through_flow(seed: int) -> dict[str, float]:
    """A spring and a pump of the same rate for 30 s: changes of mass and of the level, twice the
    mean height, against the mean of the first 2 s after 2 s."""
    flow = {"radius": RADIUS, "speed": SPEED}
    corners = ([0.08, 0, 0.08], [0.22, 0, 0.22])
    sim = build(
        tanks.tank((EDGE, EDGE), DEPTH, SPACING, 1, seed=seed),
        {
            "inflows": [{"centre": corners[0], **flow}],
            "outflows": [{"centre": corners[1], **flow}],
            "duration": 30.0,
        },
    )
    masses, levels = [], []
    for _ in range(round(30.0 / tanks.FRAME)):
        sim.advance(tanks.FRAME, STILL)
        heights = inside(sim)
        masses.append(float(len(heights)))
        levels.append(2.0 * float(heights.mean()))
    sim.close()
    first = slice(round(2.0 / tanks.FRAME), round(4.0 / tanks.FRAME))
    after = slice(round(4.0 / tanks.FRAME), None)
    change = {
        name: float(np.abs(np.array(values[after]) / np.mean(values[first]) - 1.0).max())
        for name, values in (("mass", masses), ("level", levels))
    }
    return {f"largest change of the {name} in 30 s": value for name, value in change.items()}


def jet(seed: int) -> dict[str, float]:
    """A jet from a dry floor: mean of the highest points that the particles of its first FOLLOWED
    seconds reach, over v^2/(2 g)."""
    corner = {"layer": 0, "lo": [0, 0, 0], "hi": [0.1, 0.025, 0.6]}
    scene = tanks.tank((0.6, 0.6), 0.025, FINE, 1, air=0.9, seed=seed)
    sim = build(
        scene,
        {
            "water": [corner],
            "inflows": [{"centre": [0.35, 0, 0.3], "radius": JET_RADIUS, "speed": JET_SPEED}],
            "duration": 0.6,
        },
    )
    highest: dict[int, float] = {}
    started = set(sim.particles.numpy("id")[sim.particles.numpy("x")[:, 1] > 0.0].tolist())
    while sim.time < 0.45:
        sim.advance(tanks.FRAME, STILL)
        rows = zip(sim.particles.numpy("id").tolist(), sim.particles.numpy("x")[:, 1], strict=True)
        for number, y in rows:
            known = number in highest or (sim.time < FOLLOWED and number not in started)
            if known:
                highest[number] = max(highest.get(number, 0.0), float(y))
    sim.close()
    theory = JET_SPEED**2 / (2.0 * tanks.GRAVITY)
    return {"height / (v^2/(2 g)) - 1": float(np.mean(list(highest.values()))) / theory - 1.0}


def filling(seed: int) -> dict[str, float]:
    """A spring fills a basin from 0.1 to 0.2 m: level, twice the mean height, against the one by
    rate and time, in the mean of the last half second."""
    spring = {"centre": [0.15, 0, 0.15], "radius": RADIUS, "speed": SPEED}
    sim = build(
        tanks.tank((EDGE, EDGE), 0.1, SPACING, 1, seed=seed), {"inflows": [spring], "duration": 5.0}
    )
    begin = 2.0 * float(inside(sim).mean())
    errors, rate = [], math.pi * RADIUS**2 * SPEED / EDGE**2
    while sim.time < 0.1 / rate:
        sim.advance(tanks.FRAME, STILL)
        level = begin + rate * sim.time
        errors.append(2.0 * float(inside(sim).mean()) / level - 1.0)
    sim.close()
    last = errors[-round(0.5 / tanks.FRAME) :]
    return {"level / theory - 1": float(np.mean(last))}


CASES = (
    (f"Tank {DEEP} m deep, slit {SLIT / FINE:.0f} spacings wide", drained, "within 3 %, 5 %"),
    ("Spring and pump of the same rate", through_flow, "within 1 %"),
    (f"Vertical jet, {2 * JET_RADIUS / FINE:.0f} spacings in diameter", jet, "within 3 %"),
    ("Basin that a spring fills", filling, "within 1 %"),
)


@click.command()
@click.option("--arch", default="cpu", show_default=True)
@click.option("--threads", type=int, help="CPU threads")
def main(arch: str, threads: int | None) -> None:
    """Measure inflows and outflows, and write bench/results/boundaries.md."""
    report = [heading("Inflows and outflows", start(arch, threads))]
    rows = []
    for name, case, target in CASES:
        found = [case(seed) for seed in range(floating.STARTS)]
        for figure in found[0]:
            spread = floating.rows.spread([f[figure] for f in found], "{:+.2%}")
            rows.append({"case": name, "figure": figure, "found": spread, "target": target})
            click.echo(" | ".join(rows[-1].values()))
    report += [
        f"Medians of {floating.STARTS} starts and their range; computed from positions and "
        "velocities.\nThe theory of the draining time has the contraction pi/(pi + 2) = 0.611 of "
        "the plane jet.\n",
        tabulate(rows, "keys", "github", disable_numparse=True),
        "",
    ]
    (RESULTS / "boundaries.md").write_text("\n".join(report))


if __name__ == "__main__":
    main()
