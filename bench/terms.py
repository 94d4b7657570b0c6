"""Cost and error of each optional term of the projection method, and of each part of a scene."""

import statistics
import time
from functools import partial

import numpy as np
import taichi as ti
from scipy.spatial.transform import Rotation

from bench import parts, tanks
from bench.tables import Bench, Table
from bench.water import Ours
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
VISCOUS = {name: terms for name, terms in TERMS.items() if "viscosity" in terms}
# Timed tank: spacing [m], width and depth in spacings; rounds, and steps of each.
TIMED, ACROSS, LEVELS, ROUNDS, STEPS = 0.02, 24, 12, 5, 12
# Box of 1 m for decaying flows: edge and depth in spacings.
CELLS, DEEP = 16, 6
# Speed [m/s] of the vortex U (sin pi x cos pi z, 0, -cos pi x sin pi z) in a tank. The formula is
# for a box with a lid. Under a free surface the pressure rho U^2/4 (cos 2 pi x + cos 2 pi z) causes
# waves with up to U^2/(2 g D) of the energy at depth D: 0.4 % of the amplitude at 0.25 m/s, 6.4 %
# at 1 m/s (D = 0.4 m).
VORTEX_SPEED = 0.25
# Time in which the vortex decays [s].
FLOW_SECONDS = 0.15
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


def cost(seed: int) -> list[dict[str, str | float]]:
    """Returns the rows of the time per step with each term; the tanks run in alternating rounds."""
    size = (ACROSS * TIMED, 2 * LEVELS * TIMED, ACROSS * TIMED)
    x = lattice((ACROSS, LEVELS, ACROSS), TIMED)
    x[:, 1] *= 1.0 + 0.1 * np.cos(np.pi * x[:, 0] / size[0])
    dt, times = tanks.FRAME / 2.0, {name: [] for name in TERMS}
    sims = {name: build(x, TIMED, size, **terms) for name, terms in TERMS.items()}
    for turn in range(ROUNDS + 1):
        for name, sim in sims.items():
            found = [
                milliseconds(lambda s=sim: s.solver.step(dt, ExternalForces()))
                for _ in range(STEPS)
            ]
            times[name] += found if turn else []  # the first turn compiles
    rows = []
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


def row(term: str, formula: float, found: float) -> dict[str, str | float]:
    """Returns a table row: a measured value against a formula."""
    return {"term": term, "formula": formula, "found": found, "error": found / formula - 1.0}


def term_alone(seed: int) -> list[dict[str, str | float]]:
    """Returns the rows of the decay of a Taylor-Green vortex by the term alone, with particles at
    constant positions in a full box of stirred water: rates [1/s]."""
    x, size = stirred(DEEP, 0)
    d, steps, rows = 1.0 / CELLS, 20, []
    for name, terms in VISCOUS.items():
        sim = build(x, d, size, **terms)
        sim.measure_density()
        sim.particles.fields["pressure_multiplier"].fill(0.0)
        viscosity = sim.solver.force(Viscosity)
        set_velocity(sim, vortex(sim.particles.numpy("x").astype(float)))
        before = amplitude(sim)
        # Short steps: tar would come to rest within a step.
        rate = 2.0 * np.pi**2 * terms["viscosity"] / 1000.0
        step = min(tanks.FRAME / 2.0, 0.1 / rate)
        for _ in range(steps):
            viscosity.apply(step, ExternalForces())
        rows.append(row(name, rate, -np.log(amplitude(sim) / before) / steps / step))
    return rows


def in_flow(seed: int) -> list[dict[str, str | float]]:
    """Returns the rows of the decay of a vortex in a tank with a free surface, by the whole method:
    relative amplitudes.

    Without viscosity all decay is error; runs with a term are compared with the run without.
    """
    x, size = stirred(DEEP, 4)
    rows, without = [], 1.0
    for name, terms in {"none": {}, **VISCOUS}.items():
        sim = build(x, 1.0 / CELLS, size, **terms)
        sim.advance(tanks.FRAME, ExternalForces())
        v = VORTEX_SPEED * vortex(sim.particles.numpy("x").astype(float))
        set_velocity(sim, sim.particles.numpy("v") + v)
        before = amplitude(sim)
        sim.advance(FLOW_SECONDS, ExternalForces())
        left = amplitude(sim) / before
        without = without if terms else left
        decay = np.exp(-2.0 * np.pi**2 * terms.get("viscosity", 0.0) / 1000.0 * FLOW_SECONDS)
        rows.append(row(name, decay, left / (without if terms else 1.0)))
    return rows


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
    found = tanks.fitted_period(times, np.array(long), period)
    axes = np.sqrt(5.0 * np.linalg.eigvalsh(np.cov(x.T))) / radius
    laplace = 2.0 * WATER_TENSION / radius
    return {
        "Lamb's period": found / period - 1.0,
        "Laplace's pressure 2 sigma/R": float(np.mean(inside[44:])) / laplace - 1.0,
        "shortest axis over R": axes[0] - 1.0,
        "longest axis over R": axes[2] - 1.0,
    }


def conservation(seed: int) -> list[dict[str, str | float]]:
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
        linear, angular, scale, spin = Ours(sim).momenta(middle)
        for _ in range(15):
            sim.advance(tanks.FRAME, WEIGHTLESS)
        after, turned, _, _ = Ours(sim).momenta(middle)
        rows.append(
            {
                "term": name,
                "momentum over sum m v": np.linalg.norm(after - linear) / scale,
                "angular momentum over sum m r v": np.linalg.norm(turned - angular) / spin,
            }
        )
    return rows


ERROR = {"formula": ".3g", "found": ".3g", "error": "+.1%"}
DRIFTS = {"momentum over sum m v": ".1e", "angular momentum over sum m r v": ".1e"}
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
            "alone": Table(
                "Taylor-Green vortex, term alone: rate 2 nu k^2, 1/s",
                (),
                {(): term_alone},
                ERROR,
                starts=1,
            ),
            "flow": Table(
                f"Relative amplitude of a vortex of {VORTEX_SPEED:g} m/s after {FLOW_SECONDS:g} s; "
                "with a term: over the amplitude with no term",
                (),
                {(): in_flow},
                ERROR,
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
            "momentum": Table(
                "Momentum drift of a ball of two layers in 15 frames",
                (),
                {(): conservation},
                DRIFTS,
                starts=1,
            ),
            "parts": parts.TABLE,
        },
    )
}
