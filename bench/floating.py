"""Cases of floating bodies of bench/bodies.py: drafts, heave decay, conservation, stability."""

import math
from typing import Any

import numpy as np
from scipy.optimize import brentq, minimize
from scipy.stats import qmc

from bench import tanks
from bench.heave_theory import decay
from msph.fluid.boundary.rigid_bodies import volume
from msph.fluid.external_forces import ExternalForces
from msph.fluid.simulation import Simulation

# Simulated times of drafts, of cubes that turn and of hard cases [s]. A floating body bobs until
# the end: drafts are means over the last BOBS [s], about five periods.
AFLOAT, TURNING, BOBS, HARDSHIP = 6.0, 9.0, 3.0, 2.0
# Spin [degrees/s] and axis that start the turn of a cube: lying flat is an unstable equilibrium.
KICK, AXIS = 40.0, [1.0, 0.0, 0.6]
# Still water: edge of the square box, depth, finest spacing [m], edge of the cube and diameter of
# the ball [m].
EDGE, DEPTH, FINE, HEIGHT = 0.6, 0.4, 0.025, 0.2
DENSITIES = (250.0, 500.0, 750.0)
# Heave decay of Kramer et al. 2021: radius, mass, depth [m, kg], water density [kg/m^3], gravity
# [m/s^2]; first period [s] and first trough [m] by the height of the release [m]. The period is
# twice the time under water, between the first two passages of the equilibrium.
RADIUS, MASS, DEEP = 0.15, 7.056, 0.9
KRAMER_WATER, KRAMER_GRAVITY = 998.2, 9.82
KRAMER = {0.02916: (0.7869, 0.02493), 0.08918: (0.8093, 0.07573), 0.15006: (0.8671, 0.12862)}
# Simulated time after the release [s]: the second passage of the highest release is at 0.67 s.
DECAY = 0.75
# Particles of the pool: room for bands of full thickness.
CAPACITY = 400_000
# Time [s] for which the ball is held, in which the water settles and the hole around it fills.
HELD = 1.5


def build(layers: int, bodies: list[dict], seed: int, fine: float = FINE) -> Simulation:
    """Returns a simulation of a tank of still water with bodies."""
    return tanks.build(tanks.tank((EDGE, EDGE), DEPTH, fine, layers, 0.4, seed=seed, bodies=bodies))


def draft(kind: str, density: float, layers: int, fine: float, seed: int) -> dict[str, Any]:
    """Returns the figures of a body that floats: mean error over the last BOBS [s] of the height
    of its waterline, over the body's height; fine [m]: finest spacing."""
    half = 0.5 * HEIGHT
    samples = np.random.default_rng(0).uniform(-half, half, (100_000, 3))
    if kind == "ball":
        samples = samples[np.linalg.norm(samples, axis=1) < half]
    x = [0.5 * EDGE, DEPTH + half - HEIGHT * density / 1000.0, 0.5 * EDGE]
    shape: dict[str, Any] = {"centre": x, "radius": half}
    if kind == "cube":
        corners = {"lo": [c - half for c in x], "hi": [c + half for c in x]}
        shape = {**corners, "spin": KICK, "axis": AXIS}
    sim = build(layers, [{**shape, "density": density}], seed, fine)
    level = tanks.water_volume(sim) + volume(sim.boundary.bodies[0]) * density / 1000.0
    level /= EDGE**2
    seconds, floating = TURNING if kind == "cube" else AFLOAT, sim.boundary.floating
    # Vertical components of the body's axes, and heights of the waterline at which its submerged
    # volume carries its weight.
    ups, wanted = [], []

    def read() -> None:
        if sim.time > seconds - BOBS + 0.5 * tanks.FRAME:
            ups.append(floating.turn[0, 1].copy())
            wanted.append(floating.x[0, 1] + np.quantile(samples @ ups[-1], density / 1000.0))

    ledger = tanks.recorded(sim, seconds, read=read)
    found = {
        "draft error": float((level - np.mean(wanted)) / HEIGHT),
        "energy gain": ledger.energy_gain(),
    }
    if kind == "cube":
        found["steepest axis"] = float(np.abs(ups).max(axis=1).mean())
        found["steepest axis of least energy"] = least_energy(density / 1000.0)
    return found


def least_energy(density: float) -> float:
    """Returns the largest component along the vertical of the axes of a cube that floats with the
    least potential energy; density: over the density of water (-). In this attitude the centre of
    the cube has the least height above the centre of its submerged part."""
    points = qmc.Sobol(3, seed=1).random_base2(16) - 0.5
    submerged = round(density * len(points))

    def height(way: np.ndarray) -> float:
        depths = points @ (way / np.linalg.norm(way))
        return -float(np.partition(depths, submerged)[:submerged].mean())

    starts = np.random.default_rng(0).normal(size=(8, 3))
    found = min((minimize(height, w, method="Nelder-Mead") for w in starts), key=lambda f: f.fun)
    return float(np.abs(found.x).max() / np.linalg.norm(found.x))


def heave(
    drop: float, layers: int, fine: float, width: float, relief: float, seed: int
) -> dict[str, float]:
    """Returns the figures of the heave decay of a half-submerged ball that is released at the
    height `drop` [m], in a square tank of `width` [m]; relief: share of shear relief (-)."""
    draft = brentq(
        lambda d: math.pi * d**2 * (RADIUS - d / 3.0) * KRAMER_WATER - MASS, 0, 2 * RADIUS
    )
    options: dict[str, Any] = {
        "seed": seed,
        "density": KRAMER_WATER,
        "projection": {"shear_relief": relief},
        "adaptation": {"capacity": CAPACITY},
    }
    external, full = ExternalForces((0.0, -KRAMER_GRAVITY, 0.0)), DEEP + RADIUS - draft

    def held(height: float) -> tuple[Simulation, float]:
        """Returns the tank with the ball at a height [m], and the height [m] at which the volume of
        the water lets it float: water inside the ball at the start is omitted."""
        ball = {"centre": [0.5 * width, height, 0.5 * width], "radius": RADIUS, "mass": MASS}
        bodies = [ball | {"release": HELD}]
        tank = tanks.tank((width, width), DEEP, fine, layers, 0.4, bodies=bodies, **options)
        sim = tanks.build(tank)
        return sim, (tanks.water_volume(sim) + MASS / KRAMER_WATER) / width**2 + RADIUS - draft

    sim, rest = held(full)
    entries = tanks.recorded(sim, HELD, lambda time: external).entries
    first, last = entries[len(entries) // 2], entries[-1]
    force = (first.body_impulse[1] - last.body_impulse[1]) / (last.time - first.time)
    stiffness = KRAMER_WATER * KRAMER_GRAVITY * math.pi * RADIUS**2
    # The bulk density is not exact: at 6 spacings per radius the water stands 0.5 mm higher.
    higher = full - rest + (force - MASS * KRAMER_GRAVITY) / stiffness
    sim.close()
    sim, rest = held(rest + drop)
    times, heights = [], []
    while sim.time < HELD + DECAY:
        sim.advance(0.005, external)
        times.append(sim.time - HELD)
        heights.append(float(sim.boundary.floating.x[0, 1]) - rest - higher)
    period, trough = first_period(np.array(times), np.array(heights))
    measured, theory = KRAMER[drop], first_period(*decay(drop, RADIUS, KRAMER_GRAVITY, DECAY))
    return {
        "period error": period / measured[0] - 1.0,
        "trough error": trough / measured[1] - 1.0,
        "period, potential flow": period / theory[0] - 1.0,
        "trough, potential flow": trough / theory[1] - 1.0,
    }


def first_period(t: np.ndarray, z: np.ndarray) -> tuple[float, float]:
    """Returns twice the time [s] between the first two zeros of heights z [m] at times t [s], and
    the depth [m] of the trough between them."""
    before = np.flatnonzero(np.diff(np.sign(z)))[:2]
    first, second = t[before] - z[before] * (t[before + 1] - t[before]) / (
        z[before + 1] - z[before]
    )
    return float(2.0 * (second - first)), -float(z.min())


def collision(density: float, seed: int) -> dict[str, float]:
    """Returns the figures of water and a spinning cube that collide without gravity."""
    cube = {"lo": [0.62, 0.45, 0.48], "hi": [0.72, 0.55, 0.58], "density": density}
    water = {"centre": [0.35, 0.5, 0.5], "radius": 0.15, "velocity": [1, 0, 0]}
    bodies = [{**cube, "velocity": [-0.5, 0, 0], "spin": 50}]
    scene = tanks.scene((1, 1, 1), FINE, 1, [water], seed=seed, bodies=bodies)
    # After 0.32 s water reaches walls of the box, to which it gives momentum.
    ledger = tanks.recorded(tanks.build(scene), 0.3, lambda time: ExternalForces((0, 0, 0)))
    first, last = ledger.entries[0], ledger.entries[-1]
    momentum = last.momentum + last.floating_momentum - first.momentum - first.floating_momentum
    angular = last.angular_momentum + last.floating_angular_momentum
    angular = angular - first.angular_momentum - first.floating_angular_momentum
    return {
        "momentum": float(np.abs(momentum).max()) / first.momentum_scale,
        "angular momentum": float(np.abs(angular).max()) / first.angular_scale,
        "energy gain": ledger.energy_gain(),
    }


def _ball(x: list[float], radius: float, density: float, **more: Any) -> dict[str, Any]:
    return {"centre": x, "radius": radius, "density": density, **more}


def _crowd() -> list[dict[str, Any]]:
    """Returns twenty boxes and balls of 0.1 to twice the water's density above the water."""
    found = []
    for k in range(20):
        x = [0.1 + 0.13 * (k % 4), 0.52 + 0.14 * (k // 16), 0.1 + 0.13 * (k // 4 % 4)]
        density = (100.0, 400.0, 700.0, 2000.0)[k % 4]
        box = {"lo": [c - 0.05 for c in x], "hi": [c + 0.05 for c in x], "density": density}
        found.append(_ball(x, 0.05, density) if k % 2 else box)
    return found


# Hard cases: bodies by the name of the case.
HARD = {
    "0.05 of the water's density, falls in": [_ball([0.3, 0.55, 0.3], 0.1, 50.0)],
    "20 times the water's density, falls in": [_ball([0.3, 0.55, 0.3], 0.1, 20_000.0)],
    "falls in at 5 m/s": [_ball([0.3, 0.55, 0.3], 0.1, 500.0, velocity=[0, -5, 0])],
    "held on the floor for 1 s": [_ball([0.3, 0.1, 0.3], 0.1, 500.0, release=1.0)],
    "twenty boxes and balls": _crowd(),
}


def hard(name: str, seed: int) -> dict[str, float]:
    """Returns the figures of a hard case."""
    sim = build(1, HARD[name], seed)
    ledger = tanks.recorded(sim, HARDSHIP)
    return {
        "energy gain": ledger.energy_gain(),
        "fastest body at the end [m/s]": np.linalg.norm(sim.boundary.floating.v, axis=1).max(),
        "leaked particles": max(e.outside for e in ledger.entries),
    }
