"""Numerical friction: decay of low waves and drag of a slowly towed ball, without and with shear
relief, in uniform and layered water.

Decrements and forces are computed from positions and from the impulse on the body.
"""

import math
from functools import partial

import numpy as np

from bench import tanks
from bench.cases import CASES
from bench.cases.case import ADAPTIVE, UNIFORM, Setting
from bench.rows import STARTS
from bench.tables import Bench, Table

# Length, width and depth of the tank of the waves [m]; time at rest before the wave [s]; periods.
LENGTH, WIDTH, DEPTH, SETTLE, PERIODS = 0.9, 0.3, 0.3, 1.0, 4
# Depth in finest spacings and amplitude over depth.
WAVES = ((8, 0.03), (8, 0.1), (12, 0.03), (12, 0.1), (20, 0.03))
# Number of layers of each kind of water.
WATERS = {"uniform": 1, "layered": 3}
RELIEFS = {"0": 0.0, "1": 1.0}
# Cases of bench/pareto.py whose times are compared: name, kind of water, resolution.
TIMED = [
    ("sloshing", UNIFORM, 10),
    ("sloshing", ADAPTIVE, 10),
    ("sloshing", ADAPTIVE, 15),
    ("deep_sloshing", ADAPTIVE, 28),
    ("deep_sloshing", ADAPTIVE, 40),
    ("hydrostatic", UNIFORM, 12),
    ("hydrostatic", ADAPTIVE, 20),
]
# Towed ball: footprint of the tank, depth and air [m], radius, start, spacing [m]; speeds [m/s].
FOOTPRINT, WATER, AIR, RADIUS, FROM, SPACING = (1.8, 0.6), 0.5, 0.2, 0.1, 0.3, 0.03
SPEEDS = (0.5, 1.0)
# Distances between which the force is measured [m]: after the start, before the far wall.
MEASURED = (0.4, 0.9)


def wave(
    spacings: int, amplitude: float, layers: int, relief: float, seed: int
) -> dict[str, float]:
    """Returns the logarithmic decrement per period of the first mode (theory: 0) and the error of
    its period (-), from the centre of mass."""
    more = {"seed": seed, "projection": {"shear_relief": relief}}
    sim = tanks.build(tanks.tank((LENGTH, WIDTH), DEPTH, DEPTH / spacings, layers, 0.1, **more))
    tanks.run(sim, SETTLE)
    tanks.slosh(sim, DEPTH, amplitude * DEPTH)
    theory, reading = tanks.slosh_period(LENGTH, DEPTH), tanks.Reading(sim)
    tanks.run(sim, PERIODS * theory, reading)
    rate, period = tanks.fitted_wave(
        [t - SETTLE for t in reading.times], np.array(reading.centres)[:, 0], theory
    )
    return {
        "particles": sim.particles.count,
        "decrement": rate * period,
        "period off": period / theory - 1.0,
    }


def in_turn(case: str, water: str, resolution: int, seed: int) -> list[dict[str, float]]:
    """Returns the processor times and main errors of a case with shear relief over those without
    it, one row for each start. Runs with and without alternate, so that both meet one load."""
    found = []
    for start in range(STARTS):
        times, errors = [], []
        for relief in (1.0, 0.0):
            setting = Setting(water=water, resolution=resolution, shear_relief=relief, start=start)
            run, error = CASES[case].measure(setting)
            times.append(run.cpu)
            errors.append(error[CASES[case].main])
            run.simulation.close()
        found.append(
            {
                "time, on / off": times[0] / times[1],
                "error, on / off": errors[0] / errors[1],
                "error, on": errors[0],
                "error, off": errors[1],
            }
        )
    return found


def tow(speed: float, layers: int, relief: float, seed: int) -> dict[str, float]:
    """Returns the drag coefficient of a submerged ball towed at `speed` [m/s]."""
    ball = {"centre": [FROM, 0.5 * WATER, 0.5 * FOOTPRINT[1]], "radius": RADIUS}
    towed = ball | {"velocity": [speed, 0.0, 0.0]}
    more = {"seed": seed, "bodies": [towed], "projection": {"shear_relief": relief}}
    sim = tanks.build(tanks.tank(FOOTPRINT, WATER, SPACING, layers, AIR, **more))
    begin = end = impulse = math.nan
    while speed * sim.time < MEASURED[1]:
        tanks.run(sim, tanks.FRAME)
        end = -float(sim.boundary.impulse[0, 0])
        if math.isnan(begin) and speed * sim.time >= MEASURED[0]:
            begin, impulse = sim.time, end
    force = (end - impulse) / (sim.time - begin)
    pressure = 0.5 * 1000.0 * speed**2 * math.pi * RADIUS**2
    return {"particles": sim.particles.count, "drag coefficient": force / pressure}


TABLES = {
    "waves": Table(
        "Logarithmic decrement of the first mode per period",
        ("depth in spacings", "amplitude over depth", "water", "shear relief"),
        {
            (str(n), f"{a:g}", water, name): partial(wave, n, a, layers, relief)
            for n, a in WAVES
            for water, layers in WATERS.items()
            for name, relief in RELIEFS.items()
        },
        {"particles": ",.0f", "decrement": ".3f", "period off": "+.2%"},
    ),
    "in turn": Table(
        "Cases of bench/pareto.py with shear relief over those without: processor time and main "
        "error; runs with and without alternate in one process",
        ("case", "water", "resolution"),
        {(case, water, str(n)): partial(in_turn, case, water, n) for case, water, n in TIMED},
        {
            "time, on / off": ".2f",
            "error, on / off": ".2f",
            "error, on": ".2%",
            "error, off": ".2%",
        },
        starts=1,
    ),
    "towed ball": Table(
        "Drag coefficient",
        ("speed, m/s", "water", "shear relief"),
        {
            (f"{speed:g}", water, name): partial(tow, speed, layers, relief)
            for speed in SPEEDS
            for water, layers in WATERS.items()
            for name, relief in RELIEFS.items()
        },
        {"particles": ",.0f", "drag coefficient": ".3f"},
    ),
}
BENCHES = {
    "friction": Bench(
        "Numerical friction",
        "Median (range) over the starts. An ideal liquid has a decrement of 0; at Reynolds numbers "
        "of 1e5 and 2e5\na ball in water has a drag coefficient of about 0.4.\n",
        TABLES,
    )
}
