"""Balls of water: two collide without gravity, and one falls on the floor."""

import numpy as np

from bench import tanks
from bench.cases.case import ADAPTIVE, UNIFORM, UNSHEARED, Case, Run, Setting, begin, scene

RADIUS, EDGE = 0.15, 1.2
# Edge of the box of the collision [m]: no water reaches the walls.
WIDE = 2.4
# Collision: speed [m/s], offset and initial distance [m] of each ball from the middle; duration
# [s].
SPEED, OFFSET, APART, SECONDS = 1.0, 0.04, 0.18, 0.4
# Falling ball: initial height of its centre [m], and time after the impact in which the energy is
# recorded [s]. The loss is measured when the ball, unhindered, would have fallen by its radius
# below first contact, before spray reaches the walls.
HIGH, AFTER = 0.75, 0.3


def collision(setting: Setting) -> tuple[Run, dict[str, float]]:
    """Runs the collision; returns the run and its errors."""
    middle = np.full(3, 0.5 * WIDE)
    water = []
    for side in (-1.0, 1.0):
        centre = middle + side * np.array([APART, -OFFSET, 0.0])
        water.append(
            {"centre": centre.tolist(), "radius": RADIUS, "velocity": [-side * SPEED, 0, 0]}
        )
    still = {"gravity": [0.0, 0.0, 0.0]}
    run = begin(setting, scene(setting, (WIDE,) * 3, RADIUS / setting.resolution, water, **still))
    linear, angular, scale, spin = run.water.momenta(middle)
    energies, mass = [run.water.energy(0.0)], run.water.masses().sum()
    run.go(SECONDS, lambda: energies.append(run.water.energy(0.0)), gravity=0.0)
    after, turned, _, _ = run.water.momenta(middle)
    return run, {
        "angular_momentum": float(np.linalg.norm(turned - angular)) / spin,
        "momentum": float(np.linalg.norm(after - linear)) / scale,
        "mass": float(abs(run.water.masses().sum() / mass - 1.0)),
        "energy_rise": tanks.largest_rise(energies) / energies[0],
    }


def falling(setting: Setting) -> tuple[Run, dict[str, float]]:
    """Runs the falling ball; returns the run and its errors."""
    water = [{"centre": [0.5 * EDGE, HIGH, 0.5 * EDGE], "radius": RADIUS}]
    run = begin(setting, scene(setting, (EDGE,) * 3, RADIUS / setting.resolution, water))
    start, first = run.water.centre(), run.water.energy()
    way = HIGH - RADIUS - 2.0 * RADIUS / setting.resolution
    until = float(np.sqrt(2.0 * way / tanks.GRAVITY))
    frames = int(until / tanks.FRAME)
    run.go(frames * tanks.FRAME)
    fall = 0.5 * tanks.GRAVITY * (frames * tanks.FRAME) ** 2
    off = float(np.linalg.norm(run.water.centre() - start + [0.0, fall, 0.0]))
    kept = run.water.energy() / first - 1.0
    energies = [run.water.energy()]
    touch = float(np.sqrt(2.0 * (HIGH - RADIUS) / tanks.GRAVITY))
    burst = touch + RADIUS / (tanks.GRAVITY * touch)
    run.go(
        int(burst / tanks.FRAME) * tanks.FRAME - run.simulated,
        lambda: energies.append(run.water.energy()),
    )
    lost = 1.0 - energies[-1] / energies[0]
    run.go(AFTER, lambda: energies.append(run.water.energy()))
    return run, {
        "loss": abs(lost),
        "way": off / fall,
        "energy": abs(kept),
        "energy_rise": tanks.largest_rise(energies) / first,
    }


COLLISION = Case(
    "collision",
    "Two balls collide off centre without gravity",
    "radius of the balls",
    {
        "angular_momentum": "drift of the angular momentum, over sum m r v",
        "momentum": "drift of the momentum, over sum m v",
        "mass": "drift of the mass",
        "energy_rise": "largest rise of the energy, over the energy at the start",
    },
    (4, 6, 8),
    collision,
    kinds=(UNIFORM, ADAPTIVE),
    classic=(UNIFORM,),
)
FALLING_DROP = Case(
    "falling_drop",
    "A ball of water falls on the floor",
    "radius of the ball",
    {
        "loss": "share of the energy lost in the impact; an ideal liquid without air loses none",
        "way": "distance of the centre from free fall before the impact, over the height of fall",
        "energy": "change of the energy before the impact, over the energy at the start",
        "energy_rise": "largest rise of the energy after the impact, over the energy at the start",
    },
    (4, 6, 8, 12),
    falling,
    kinds=(UNIFORM, ADAPTIVE),
    classic=(UNIFORM,),
    varied=(UNSHEARED,),
)
