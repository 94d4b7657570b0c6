"""Errors of the projection method against formulas, for uniform and layered water.

A difference between uniform and layered water is significant only if it exceeds the range over the
starts.
"""

from functools import partial

import numpy as np

from bench import tanks
from bench.tables import Bench, Table
from bench.water import Ours

# Kinds of water: number of layers, and changed adaptation parameters. "uniform, irregular" starts
# like layered water, from cubes halved along random axes, but all particles have the finest size
# (bands reach the floor, no pass follows): it shows the errors due to the initial arrangement.
WATERS: dict[str, tuple[int, dict[str, float]]] = {
    "uniform": (1, {}),
    "uniform, irregular": (3, {"band": 30.0, "every": 10**9}),
    "layered": (4, {}),
}
# Still water: finest spacing [m], depth in spacings, and time [s]; the column is 10 spacings wide.
FINE, SPACINGS_DEEP, STILL_SECONDS = 0.02, 60, 10.0
# Falling in a duct: edge [m], viscosity [Pa s], finest spacings across; times between which it is
# measured [s], and distance of the measured heights from the ends of the column at the start, in
# edges: the column falls, and both ends bulge in the duct's middle.
EDGE, VISCOSITY, ACROSS = 0.2, 100.0, (10, 16)
DUCT_BEGIN, DUCT_END, FROM_ENDS = 0.1, 0.35, 1.25
# Forms of figures: counts, shares, energies [J].
WHOLE, SHARE, JOULE = ",.0f", ".3%", ".3g"
# Figures by case: format and target.
PRESSURE = "pressure error against rho g (H - y), rms over depth"
CHANGED = f"particles that changed layer in {STILL_SECONDS - 1:g} s"
STILL = {
    "particles": (WHOLE, ""),
    f"{PRESSURE}, probes": (SHARE, "2 %"),
    f"{PRESSURE}, particle means": (SHARE, "2 %"),
    "solver residual, mean": (SHARE, "0.2 %"),
    "solver residual, 99th percentile": (SHARE, ""),
    "solver residual, largest": (SHARE, "2 %"),
    "height of the centre of mass against rest": (SHARE, "1 %"),
    "energy, largest rise in 1 s": (SHARE, "0.1 %"),
    "kinetic energy, first second, J": (JOULE, ""),
    "kinetic energy, last second, J": (JOULE, "decays"),
    CHANGED: (WHOLE, ""),
}
DUCT = {
    "particles": (WHOLE, ""),
    "flow against theory, mean over time": (SHARE, "3 %, layers 5 %"),
    "speed within a spacing of the walls": (SHARE, ""),
}


def still(kind: str, seed: int) -> dict[str, float]:
    """Returns the figures of water that should remain at rest."""
    layers, changes = WATERS[kind]
    footprint = (10 * FINE, 10 * FINE)
    depth = SPACINGS_DEEP * FINE
    sim = tanks.build(tanks.tank(footprint, depth, FINE, layers, seed=seed, adaptation=changes))
    reading = tanks.Reading(sim)
    reading.read()
    tanks.run(sim, 1.0, reading)
    changed = np.array(sim.counts())
    later, profile = tanks.Reading(sim), tanks.Profile(sim, reading.depth)
    tanks.run(sim, STILL_SECONDS - 1.0, later, profile)
    frames = round(1.0 / tanks.FRAME)
    return {
        "particles": sim.particles.count,
        f"{PRESSURE}, probes": profile.error(),
        f"{PRESSURE}, particle means": later.pressure_error(),
        "solver residual, mean": float(np.mean(later.error_mean)),
        "solver residual, 99th percentile": float(np.mean(later.error_p99)),
        "solver residual, largest": max(later.error_max),
        "height of the centre of mass against rest": later.volume_error(),
        "energy, largest rise in 1 s": max(reading.energy_rise(), later.energy_rise()),
        "kinetic energy, first second, J": float(np.mean(reading.kinetic[-frames:])),
        "kinetic energy, last second, J": float(np.mean(later.kinetic[-frames:])),
        CHANGED: int(np.abs(changed - sim.counts()).sum()),
    }


def duct(spacings: int, kind: str, seed: int) -> dict[str, float]:
    """Returns the figures of viscous water that falls in a square duct without slip."""
    layers, changes = WATERS[kind]
    sim = tanks.build(tanks.duct(EDGE, spacings, VISCOSITY, layers, seed=seed, adaptation=changes))
    tanks.run(sim, DUCT_BEGIN)
    water = Ours(sim)
    bottom, top = tanks.DUCT_WATER
    flows, sheets = [], []
    while sim.time < DUCT_END:
        tanks.run(sim, tanks.FRAME)
        x, v, m = water.positions(), water.velocities(), water.masses()
        theory = tanks.duct_speed(x[:, 0], x[:, 2], EDGE, VISCOSITY / 1000.0, sim.time)
        height = x[:, 1] / EDGE
        middle = (height > bottom + FROM_ENDS) & (height < top - FROM_ENDS)
        side = np.minimum(x[:, [0, 2]], EDGE - x[:, [0, 2]]).min(axis=1)
        sheet = middle & (side < np.cbrt(m / 1000.0))
        for errors, at in ((flows, middle), (sheets, sheet)):
            errors.append(-(m * v[:, 1])[at].sum() / (m * theory)[at].sum() - 1.0)
    return {
        "particles": sim.particles.count,
        "flow against theory, mean over time": float(np.mean(flows)),
        "speed within a spacing of the walls": float(np.mean(sheets)),
    }


def table(title: str, cases: dict, figures: dict[str, tuple[str, str]]) -> Table:
    """Returns the table of cases with these figures."""
    forms, targets = ({name: of[k] for name, of in figures.items()} for k in (0, 1))
    return Table(title, (), cases, forms, targets, across=True)


TABLES = {
    "still": table(
        f"Still water, {SPACINGS_DEEP} fine spacings deep, {STILL_SECONDS:g} s",
        {(kind,): partial(still, kind) for kind in WATERS},
        STILL,
    ),
    **{
        f"duct {n}": table(
            f"Falling in a square duct without slip, {n} spacings across",
            {(kind,): partial(duct, n, kind) for kind in WATERS},
            DUCT,
        )
        for n in ACROSS
    },
}
BENCHES = {
    "accuracy": Bench(
        "Errors of the projection method",
        "Random initial arrangements: median (minimum to maximum).\n",
        TABLES,
    )
}
