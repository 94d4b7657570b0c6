"""Cost and error of each optional term of the projection method, and of each part of a scene.

python bench/terms.py [--repeats 5] [--arch cpu]
"""

import csv
import statistics
import sys
import time
from pathlib import Path

import click
import numpy as np
import taichi as ti
from scipy.spatial.transform import Rotation
from tabulate import tabulate

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from bench import parts, tanks
from bench.report import RESULTS, heading
from bench.water import Ours
from msph.device import ARCHES, start
from msph.fluid.external_forces import ExternalForces
from msph.fluid.particles.layers import LayerSpec
from msph.fluid.plan import Plan
from msph.fluid.projection.body_force import BodyForce
from msph.fluid.projection.parameters import ProjectionParameters
from msph.fluid.projection.solver import Projection
from msph.fluid.projection.viscosity import Viscosity
from msph.fluid.simulation import Simulation

WEIGHTLESS = ExternalForces(gravity=(0.0, 0.0, 0.0))
ETA = Projection.SMOOTHING
WATER_TENSION = 0.072
TERMS = {
    "none": {},
    "viscosity 1 Pa s, explicit": {"viscosity": 1.0},
    "viscosity 10 Pa s (honey), implicit": {"viscosity": 10.0},
    "viscosity 1000 Pa s (tar), implicit": {"viscosity": 1000.0},
    "tension": {"tension": WATER_TENSION},
}
# Timed tank: spacing [m], width and depth in spacings; steps per round.
TIMED, ACROSS, LEVELS, STEPS = 0.02, 24, 12, 12
# Box of 1 m for decaying flows: edge and depth in spacings.
CELLS, DEEP = 16, 6
# Title of the table of bench/parts.py.
PARTS_TITLE = (
    f"Parts of a scene, off and on: a tank of 3,072 particles, medians of {parts.FRAMES} "
    "alternating frames of 1/60 s, image 640x360"
)
# Speed [m/s] of the vortex U (sin pi x cos pi z, 0, -cos pi x sin pi z) in a tank. The formula is
# for a box with a lid. Under a free surface the pressure rho U^2/4 (cos 2 pi x + cos 2 pi z) causes
# waves with up to U^2/(2 g D) of the energy at depth D: 0.4 % of the amplitude at 0.25 m/s, 6.4 %
# at 1 m/s (D = 0.4 m).
VORTEX_SPEED = 0.25
# Drops: radius [m], radii in spacings, initial elongation (-), and number of randomly rotated and
# shifted lattices from which they are cut: periods differ by up to 10 %.
RADIUS, RESOLUTIONS, STRETCH, LATTICES = 0.005, (5, 7, 9, 12, 15), 0.1, 4


def build(x: np.ndarray, spacing: float, size, v=None, layer=None, ratio=1, **terms) -> Simulation:
    """Returns a simulation of particles at x (n, 3) [m]; if ratio > 1, layer 1 has `ratio` times
    the mass."""
    ratios = (1, ratio) if ratio > 1 else (1,)
    specs = [LayerSpec(1000.0 * spacing**3 * m, 1000.0, ETA) for m in ratios]
    x = x + np.random.default_rng(0).uniform(-0.02, 0.02, x.shape) * spacing
    initial = {"x": x.astype(np.float32)}
    initial["layer"] = np.zeros(len(x), np.int32) if layer is None else layer.astype(np.int32)
    if v is not None:
        initial["v"] = v.astype(np.float32)
    return Simulation(Plan(size, specs, initial, ProjectionParameters(**terms)))


def lattice(counts, spacing: float) -> np.ndarray:
    """Returns the points of a cubic lattice from the origin, (n, 3) [m]."""
    return (np.indices(counts).reshape(3, -1).T + 0.5) * spacing


def ball(radius: float, spacing: float, stretch=(1.0, 1.0, 1.0), seed: int = 0) -> np.ndarray:
    """Returns the points of a cubic lattice within a stretched ball about the origin, (n, 3) [m].
    seed: of a random rotation and shift of the lattice, 0 for none."""
    n = int(2.0 * radius / spacing) + 1
    x = lattice((2 * n,) * 3, spacing) - n * spacing
    if seed:
        shift = np.random.default_rng(seed).uniform(-0.5, 0.5, 3) * spacing
        x = Rotation.random(random_state=seed).apply(x + shift)
    return x[np.linalg.norm(x / np.array(stretch), axis=1) < radius]


def set_velocity(sim: Simulation, v: np.ndarray) -> None:
    """Sets the velocities of the particles to v (n, 3) [m/s]."""
    Ours(sim).set_velocities(v)


def cost(repeats: int) -> list[dict[str, str]]:
    """Returns the rows of the time per step with each term; the tanks run in alternating rounds."""
    size = (ACROSS * TIMED, 2 * LEVELS * TIMED, ACROSS * TIMED)
    x = lattice((ACROSS, LEVELS, ACROSS), TIMED)
    x[:, 1] *= 1.0 + 0.1 * np.cos(np.pi * x[:, 0] / size[0])
    dt, times, rows = tanks.FRAME / 2.0, {name: [] for name in TERMS}, []
    sims = {name: build(x, TIMED, size, **terms) for name, terms in TERMS.items()}
    for turn in range(repeats + 1):
        for name, sim in sims.items():
            found = [
                milliseconds(lambda s=sim: s.solver.step(dt, ExternalForces()))
                for _ in range(STEPS)
            ]
            times[name] += found if turn else []  # the first turn compiles
    none = statistics.median(times["none"])
    for name, found in times.items():
        low, high = np.percentile(found, [10, 90])
        solver = sims[name].solver
        viscosity = solver.force(Viscosity)
        rows.append(
            {
                "term": name,
                "ms per step": f"{statistics.median(found):.2f} ({low:.2f} to {high:.2f})",
                "over no term": f"{statistics.median(found) / none:.2f}",
                "term alone, ms": f"{alone(sims[name], dt):.2f}",
                "iterations of the term": f"{viscosity.iterations if viscosity else 0}",
                "iterations of the pressure solve": f"{solver.iterations}",
            }
        )
    return rows


def milliseconds(work) -> float:
    """Returns the elapsed time of work() [ms]."""
    ti.sync()
    begin = time.perf_counter()
    work()
    ti.sync()
    return 1e3 * (time.perf_counter() - begin)


def alone(sim: Simulation, dt: float) -> float:
    """Returns the median time [ms] of the term alone, in the last state of the run."""
    sim.measure_density()
    v, found = sim.particles.v.to_numpy(), []
    term = next((f for f in sim.solver.forces if not isinstance(f, BodyForce)), None)
    if term is None:
        return 0.0
    for _ in range(STEPS):
        sim.particles.v.from_numpy(v)
        found.append(milliseconds(lambda: term.apply(dt, ExternalForces())))
    return statistics.median(found)


def vortex(x: np.ndarray, length: float = 1.0) -> np.ndarray:
    """Returns the Taylor-Green vortex in a box of `length` [m] by 1 m at x (n, 3) [m]: (sin kx x
    cos kz z, 0, -kx/kz cos kx x sin kz z), kx = pi/length, kz = pi/1 m, (n, 3)."""
    sx, sz = np.pi * x[:, 0] / length, np.pi * x[:, 2]
    across = -np.cos(sx) * np.sin(sz) / length
    return np.stack([np.sin(sx) * np.cos(sz), 0.0 * sx, across], axis=1)


def amplitude(sim: Simulation) -> float:
    """Returns the amplitude [m/s] of the vortex by least squares."""
    x, v = (sim.particles.numpy(k).astype(float) for k in "xv")
    shape = vortex(x)
    return float((v * shape).sum() / (shape**2).sum())


def stirred(deep: int, air: int) -> tuple[np.ndarray, tuple[float, float, float]]:
    """Returns positions of particles in stirred water, (n, 3) [m], and the size of the box [m].

    deep, air: depth of water and air in spacings.
    """
    d = 1.0 / CELLS
    size, x = (1.0, (deep + air) * d, 1.0), lattice((CELLS, deep, CELLS), d)
    v = vortex(x) + np.random.default_rng(1).normal(0.0, 0.3, x.shape)
    sim = build(x, d, size, v)
    for _ in range(60):
        sim.advance(tanks.FRAME, ExternalForces())
    return sim.particles.numpy("x").astype(float), size


def row(term: str, problem: str, formula: float, found: float, digits: int = 3) -> dict[str, str]:
    """Returns a table row: a measured value against a formula."""
    return {
        "term": term,
        "reference": problem,
        "formula": f"{formula:.{digits}g}",
        "measured": f"{found:.{digits}g}",
        "error": f"{100.0 * (found / formula - 1.0):+.1f} %",
    }


def term_alone() -> list[dict[str, str]]:
    """Returns the rows of the decay of a Taylor-Green vortex by the term alone, with particles at
    constant positions in a full box of stirred water."""
    x, size = stirred(DEEP, 0)
    d, dt, steps, rows = 1.0 / CELLS, tanks.FRAME / 2.0, 20, []
    for name, terms in list(TERMS.items())[1:]:
        if "tension" in terms:
            continue
        sim = build(x, d, size, **terms)
        sim.measure_density()
        sim.particles.fields["pressure_multiplier"].fill(0.0)
        viscosity = sim.solver.force(Viscosity)
        set_velocity(sim, vortex(sim.particles.numpy("x").astype(float)))
        before, problem = amplitude(sim), "Taylor-Green, term alone, rate 2 nu k^2, 1/s"
        if viscosity:
            # Short steps: tar would come to rest within a step.
            rate = 2.0 * np.pi**2 * terms["viscosity"] / 1000.0
            step = min(dt, 0.1 / rate)
            for _ in range(steps):
                viscosity.apply(step, ExternalForces())
            rows.append(row(name, problem, rate, -np.log(amplitude(sim) / before) / steps / step))
    return rows


def in_flow(speed: float = VORTEX_SPEED, seconds: float = 0.15) -> list[dict[str, str]]:
    """Returns the rows of the decay of a vortex in a tank with a free surface, by the whole method.

    Without viscosity all decay is error; runs with a term are compared with the run without.
    """
    x, size = stirred(DEEP, 4)
    rows, without = [], 1.0
    for name, terms in TERMS.items():
        if "tension" in terms:
            continue
        sim = build(x, 1.0 / CELLS, size, **terms)
        sim.advance(tanks.FRAME, ExternalForces())
        v = speed * vortex(sim.particles.numpy("x").astype(float))
        set_velocity(sim, sim.particles.numpy("v") + v)
        before = amplitude(sim)
        sim.advance(seconds, ExternalForces())
        left = amplitude(sim) / before
        without = without if terms else left
        decay = np.exp(-2.0 * np.pi**2 * terms.get("viscosity", 0.0) / 1000.0 * seconds)
        what = f"relative amplitude of a vortex of {speed:g} m/s after {seconds:g} s"
        problem = what + (", over no term" if terms else "")
        rows.append(row(name, problem, decay, left / (without if terms else 1.0)))
    return rows


def drop(resolution: int) -> list[dict[str, str]]:
    """Returns the rows of a drop elongated by 10 %: period, pressure and shape over the
    formulas."""
    found = np.array([swing(resolution, seed) for seed in range(LATTICES)])
    rows = []
    for k, problem in enumerate(
        (
            "Lamb's period",
            "Laplace's pressure 2 sigma/R",
            "shortest axis over R at the end",
            "longest axis over R at the end",
        )
    ):
        name = f"tension, drop of R = {resolution} spacings"
        rows.append(row(name, problem, 1.0, float(np.median(found[:, k]))))
        low, high = 100.0 * (found[:, k].min() - 1.0), 100.0 * (found[:, k].max() - 1.0)
        rows[-1]["error"] += f" ({low:+.1f} to {high:+.1f} %)"
    return rows


def swing(resolution: int, seed: int) -> tuple[float, float, float, float]:
    """Returns period and pressure of a drop over Lamb's and Laplace's formulas (-), and its
    shortest and longest axis over R at the end."""
    d = RADIUS / resolution
    x = ball(RADIUS, d, (1.0 + STRETCH, 1.0 - STRETCH / 2.0, 1.0 - STRETCH / 2.0), seed)
    radius = (0.75 / np.pi * len(x) * d**3) ** (1.0 / 3.0)
    sim = build(x + 3.0 * RADIUS, d, (6.0 * RADIUS,) * 3, tension=WATER_TENSION)
    omega = np.sqrt(8.0 * WATER_TENSION / (1000.0 * radius**3))
    period, times, long, inside = 2.0 * np.pi / omega, [], [], []
    sim.advance(0.05 * period, WEIGHTLESS)
    while sim.time < 2.2 * period:
        sim.advance(period / 40.0, WEIGHTLESS)
        x = sim.particles.numpy("x").astype(float)
        x -= x.mean(axis=0)
        r = np.linalg.norm(x, axis=1)
        times.append(sim.time)
        long.append((x[:, 0] ** 2).mean() - 0.5 * (x[:, 1:] ** 2).sum(axis=1).mean())
        inside.append(sim.particles.numpy("pressure")[r < 0.6 * radius].mean())
    found = tanks.fitted_period(times, np.array(long), period)
    axes = np.sqrt(5.0 * np.linalg.eigvalsh(np.cov(x.T))) / radius
    laplace = 2.0 * WATER_TENSION / radius
    return found / period, float(np.mean(inside[44:])) / laplace, axes[0], axes[2]


def conservation() -> list[dict[str, str]]:
    """Returns the rows of the momentum drift of a rotating, sheared ball of two layers (masses
    1 : 2)."""
    d, middle, rows = 0.02, 0.6, []
    fine, coarse = ball(0.1, d), ball(0.1, 2.0 ** (1.0 / 3.0) * d)
    x = np.concatenate([fine[fine[:, 1] > 0.0], coarse[coarse[:, 1] < 0.0]]) + middle
    layer = np.repeat([0, 1], [(fine[:, 1] > 0.0).sum(), (coarse[:, 1] < 0.0).sum()])
    v = np.cross([0.0, 1.5, 0.5], x - middle)
    v[:, 0] += 0.2 * np.sin(30.0 * (x[:, 1] - middle))
    for name, terms in TERMS.items():
        terms = {**terms, **({"tension": 2.0} if "tension" in terms else {})}
        sim = build(x, d, (2.0 * middle,) * 3, v, layer, 2, **terms)
        linear, angular, scale, spin = momenta(sim, middle)
        for _ in range(15):
            sim.advance(tanks.FRAME, WEIGHTLESS)
        after, turned, _, _ = momenta(sim, middle)
        rows.append(
            {
                "term": name,
                "momentum over sum m v": f"{np.linalg.norm(after - linear) / scale:.1e}",
                "angular momentum over sum m r v": f"{np.linalg.norm(turned - angular) / spin:.1e}",
            }
        )
    return rows


def momenta(sim: Simulation, middle: float):
    """Returns momentum, angular momentum, and their scales, the sums of m |v| and m r |v|."""
    m = np.array([s.mass for s in sim.layers.specs])[sim.particles.numpy("layer")][:, None]
    x, v = (sim.particles.numpy(k).astype(float) for k in "xv")
    arm, speed = x - middle, np.linalg.norm(v, axis=1)
    scales = (m[:, 0] * speed).sum(), (m[:, 0] * np.linalg.norm(arm, axis=1) * speed).sum()
    return (m * v).sum(axis=0), (m * np.cross(arm, v)).sum(axis=0), *scales


@click.command()
@click.option(
    "--repeats",
    default=5,
    show_default=True,
    type=click.IntRange(min=1),
    help="Number of timed rounds.",
)
@click.option("--arch", type=click.Choice(ARCHES), default="auto", show_default=True)
def main(repeats: int, arch: str) -> None:
    """Measure the terms and parts, and write bench/results/terms.{md,csv}."""
    arch = start(arch)
    costs = cost(repeats)
    errors = [*term_alone(), *in_flow(), *(r for n in RESOLUTIONS for r in drop(n))]
    kept = conservation()
    sections = (
        (f"Cost: {ACROSS**2 * LEVELS:,} particles sloshing, steps of 1/120 s", costs),
        ("Error against formulas", errors),
        ("Momentum drift of a ball of two layers in 15 frames", kept),
        (PARTS_TITLE, parts.rows(arch)),
    )
    text = [heading("Cost and error of the projection method's optional terms", arch)]
    text.append(
        f"h/d = {ETA:g}. Times are medians over {repeats} rounds of {STEPS} steps, with the 10th "
        "and 90th percentile;\nthe terms run in alternating rounds.\n"
    )
    for title, rows in sections:
        table = tabulate(rows, headers="keys", tablefmt="github", disable_numparse=True)
        text += [f"## {title}\n", table, ""]
    RESULTS.mkdir(exist_ok=True)
    (RESULTS / "terms.md").write_text("\n".join(text))
    with open(RESULTS / "terms.csv", "w", newline="") as file:
        rows = [{"section": title, **r} for title, found in sections for r in found]
        writer = csv.DictWriter(file, list(dict.fromkeys(k for r in rows for k in r)))
        writer.writeheader()
        writer.writerows(rows)
    click.echo("\n".join(text))


if __name__ == "__main__":
    main()
