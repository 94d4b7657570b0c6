"""Speed and errors of the classic and the projection method in the deep pool."""

from functools import partial

import numpy as np

from bench import tanks
from bench.tables import Bench, Table
from msph.measure.bulk import bulk_density
from msph.measure.kernel_density import kernel_density
from msph.scene import load_scene
from msph.scene.build import build_simulation
from msph.stage.benchmark import benchmark

SCENE = "pool_2x"
# The particles of the thesis.
GIVEN = ("variant=system-3",)
# Compared set-ups, as changes to the scene: both methods on the particles of the thesis, and the
# projection method with seven layers in bands of one or two particles, assigned at the start.
SETUPS = {
    "classic": ("method=classic",),
    "projection": (),
    "projection, thin bands": (
        f"layers=[{', '.join(f'{{mass={0.1 * 2**k:g}}}' for k in range(7))}]",
        "water=[{layer=6, lo=[0, 0, 0], hi=[1, 1.1, 1]}]",
        "adaptation.enabled=true",
        "adaptation.band=0.5",
        f"adaptation.every={10**9}",
    ),
}
# Simulated time of each run [s].
SECONDS = 4.0
# Formats of the figures by their head in the tables.
SPEEDS = {
    "particles": ",.0f",
    "ms per frame": ".1f",
    "real-time factor": ".2f",
    "steps per frame": ".1f",
    "momentum drift": ".2%",
    "energy gain": ".2%",
}
ERRORS = {
    "pressure error, rms over depth": ".1%",
    "bulk density error": "+.2%",
    "kernel density error, mean": ".2%",
    "99th percentile of it": ".2%",
    "solver residual, mean": ".3%",
    "99th percentile": ".2%",
    "largest": ".1%",
    "height of the centre of mass": "+.2%",
    "energy rise in 1 s": ".3%",
    "kinetic energy, J": ".2f",
}


def speed(setup: str, start: int) -> dict[str, float]:
    """Returns the speed of the rocking pool, simulation only."""
    scene = load_scene(SCENE, (*GIVEN, *SETUPS[setup], f"seed={start}"))
    found = benchmark(scene, SCENE, SECONDS, render=False)
    return {
        "particles": sum(found.particles),
        "ms per frame": found.frame_p50_ms,
        "real-time factor": found.simulated_per_wall,
        "steps per frame": found.steps_per_frame,
        "momentum drift": found.momentum_drift,
        "energy gain": found.energy_gain,
    }


def errors(setup: str, start: int) -> dict[str, float]:
    """Returns the errors of the still pool over the second half of the run."""
    scene = load_scene(SCENE, (*GIVEN, *SETUPS[setup], "sway.angle=0", f"seed={start}"))
    sim = build_simulation(scene)
    reading = tanks.Reading(sim)
    tanks.run(sim, 0.5 * SECONDS)
    reading.read()
    tanks.run(sim, 0.5 * SECONDS, reading)
    water = reading.water
    x, spacing = water.positions(), water.spacings()
    kernel = kernel_density(x, spacing, sim.size)
    return {
        "pressure error, rms over depth": reading.pressure_error(),
        "bulk density error": bulk_density(x, spacing, sim.size, sim.boundary.free).mean - 1.0,
        "kernel density error, mean": kernel.mean,
        "99th percentile of it": kernel.p99,
        "solver residual, mean": float(np.mean(reading.error_mean)),
        "99th percentile": float(np.mean(reading.error_p99)),
        "largest": max(reading.error_max),
        "height of the centre of mass": reading.volume_error(),
        "energy rise in 1 s": reading.energy_rise(),
        "kinetic energy, J": reading.kinetic[-1],
    }


TABLES = {
    "speed": Table(
        f"Speed and errors of `{SCENE}`, rocking, simulation only",
        ("method",),
        {(setup,): partial(speed, setup) for setup in SETUPS},
        SPEEDS,
    ),
    "errors": Table(
        f"Errors of `{SCENE}` at rest, over the second half of {SECONDS:g} s",
        ("method",),
        {(setup,): partial(errors, setup) for setup in SETUPS},
        ERRORS,
    ),
}
BENCHES = {
    "methods": Bench(
        "Classic and projection method in the deep pool",
        "Medians (least to largest) over the starts.\n",
        TABLES,
    )
}
