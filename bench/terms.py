"""Cost of each optional term of the projection method, and drops under surface tension.

The cases of viscous flows are in bench/cases and bench/accuracy.py.
"""

import statistics
from functools import partial

import numpy as np
from scipy.spatial.transform import Rotation

from bench import tanks
from bench.tables import Bench, Table
from msph.fluid.external_forces import ExternalForces
from msph.fluid.particles.layers import LayerSpec
from msph.fluid.plan import Plan
from msph.fluid.projection.parameters import ProjectionParameters
from msph.fluid.projection.solver import Projection
from msph.fluid.projection.surface_tension import SurfaceTension
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
# Timed tank: spacing [m], width and depth in spacings; rounds, and steps of each.
TIMED, ACROSS, LEVELS, ROUNDS, STEPS = 0.02, 24, 12, 5, 12
# Drops: radius [m], radii in spacings, initial elongation (-), and number of randomly rotated and
# shifted lattices from which they are cut: periods differ by up to 10 %.
RADIUS, RESOLUTIONS, STRETCH, LATTICES = 0.005, (5, 7, 9, 12, 15), 0.1, 4


def build(x: np.ndarray, spacing: float, size, **terms) -> Simulation:
    """Returns a simulation of particles at x (n, 3) [m]."""
    x = x + np.random.default_rng(0).uniform(-0.02, 0.02, x.shape) * spacing
    initial = {"x": x.astype(np.float32), "layer": np.zeros(len(x), np.int32)}
    specs = [LayerSpec(1000.0 * spacing**3, 1000.0, ETA)]
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


def cost(seed: int) -> list[dict[str, str | float]]:
    """Returns the rows of the time per step with each term; the tanks run in alternating rounds."""
    size = (ACROSS * TIMED, 2 * LEVELS * TIMED, ACROSS * TIMED)
    x = lattice((ACROSS, LEVELS, ACROSS), TIMED)
    x[:, 1] *= 1.0 + 0.1 * np.cos(np.pi * x[:, 0] / size[0])
    dt, rows = tanks.FRAME / 2.0, []
    sims = {name: build(x, TIMED, size, **terms) for name, terms in TERMS.items()}
    steps = {name: partial(sim.solver.step, dt, ExternalForces()) for name, sim in sims.items()}
    times = tanks.in_turns(steps, ROUNDS, STEPS)
    for name, found in times.items():
        solver = sims[name].solver
        viscosity = solver.force(Viscosity)
        rows.append(
            {
                "term": name,
                "ms per step": statistics.median(found),
                "10th percentile": np.percentile(found, 10),
                "90th percentile": np.percentile(found, 90),
                "over no term": statistics.median(found) / statistics.median(times["none"]),
                "term alone, ms": alone(sims[name], dt),
                "iterations of the term": viscosity.iterations if viscosity else 0,
                "iterations of the pressure solve": solver.iterations,
            }
        )
    return rows


def alone(sim: Simulation, dt: float) -> float:
    """Returns the median time [ms] of the term alone, in the last state of the run."""
    sim.measure_density()
    v, found = sim.particles.v.to_numpy(), []
    term = sim.solver.force(Viscosity) or sim.solver.force(SurfaceTension)
    if term is None:
        return 0.0
    for _ in range(STEPS):
        sim.particles.v.from_numpy(v)
        found.append(tanks.milliseconds(lambda: term.apply(dt, ExternalForces())))
    return statistics.median(found)


def swing(resolution: int, seed: int) -> dict[str, float]:
    """Returns the figures of a drop elongated by 10 %, over the formulas: period and pressure, and
    its shortest and longest axis at the end."""
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
    _, found = tanks.fitted_wave(times, np.array(long), period)
    axes = np.sqrt(5.0 * np.linalg.eigvalsh(np.cov(x.T))) / radius
    laplace = 2.0 * WATER_TENSION / radius
    return {
        "Lamb's period": found / period - 1.0,
        "Laplace's pressure 2 sigma/R": float(np.mean(inside[44:])) / laplace - 1.0,
        "shortest axis over R": axes[0] - 1.0,
        "longest axis over R": axes[2] - 1.0,
    }


BENCHES = {
    "terms": Bench(
        "Cost and error of the projection method's optional terms",
        f"h/d = {ETA:g}.\n",
        {
            "cost": Table(
                f"Cost: {ACROSS**2 * LEVELS:,} particles sloshing, steps of 1/120 s; medians over "
                f"{ROUNDS} alternating rounds of {STEPS} steps",
                (),
                {(): cost},
                {
                    "ms per step": ".2f",
                    "10th percentile": ".2f",
                    "90th percentile": ".2f",
                    "over no term": ".2f",
                    "term alone, ms": ".2f",
                    "iterations of the term": ".0f",
                    "iterations of the pressure solve": ".0f",
                },
                starts=1,
            ),
            "drops": Table(
                f"Drops under tension, {LATTICES} lattices: errors against formulas by radius",
                ("R in spacings",),
                {(str(n),): partial(swing, n) for n in RESOLUTIONS},
                {
                    "Lamb's period": "+.1%",
                    "Laplace's pressure 2 sigma/R": "+.1%",
                    "shortest axis over R": "+.1%",
                    "longest axis over R": "+.1%",
                },
                starts=LATTICES,
            ),
        },
    )
}
