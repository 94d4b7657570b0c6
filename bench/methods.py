"""Speed and errors of the classic and the projection method in the deep pool."""

from functools import partial

import numpy as np

from bench import tanks
from bench.tables import Bench, Declared, Figures, Table, figures, forms
from msph.scene import load_scene
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
# Figures of a benchmark.
SPEEDS: Declared = {
    "particles": (",.0f", lambda run: sum(run.particles)),
    "ms per frame": (".1f", lambda run: run.frame_p50_ms),
    "real-time factor": (".2f", lambda run: run.simulated_per_wall),
    "steps per frame": (".1f", lambda run: run.steps_per_frame),
    "momentum drift": (".2%", lambda run: run.momentum_drift),
    "energy gain": (".2%", lambda run: run.energy_gain),
}
# Figures of a reading.
ERRORS: Declared = {
    "pressure error, rms over depth": (".1%", lambda reading: reading.pressure_error()),
    "bulk density error": ("+.2%", lambda reading: reading.water.bulk_density() - 1.0),
    "kernel density error, mean": (".2%", lambda reading: reading.water.kernel_density().mean),
    "99th percentile of it": (".2%", lambda reading: reading.water.kernel_density().p99),
    "solver residual, mean": (".3%", lambda reading: np.mean(reading.error_mean)),
    "99th percentile": (".2%", lambda reading: np.mean(reading.error_p99)),
    "largest": (".1%", lambda reading: max(reading.error_max)),
    "height of the centre of mass": ("+.2%", lambda reading: reading.volume_error()),
    "energy rise in 1 s": (".3%", lambda reading: reading.energy_rise()),
    "kinetic energy, J": (".2f", lambda reading: reading.kinetic[-1]),
}


def speed(setup: str, start: int) -> Figures:
    """Returns the speed of the rocking pool, simulation only."""
    scene = load_scene(SCENE, (*GIVEN, *SETUPS[setup], f"seed={start}"))
    return figures(SPEEDS, benchmark(scene, SCENE, SECONDS, render=False))


def errors(setup: str, start: int) -> Figures:
    """Returns the errors of the still pool over the second half of the run."""
    scene = load_scene(SCENE, (*GIVEN, *SETUPS[setup], "sway.angle=0", f"seed={start}"))
    sim = tanks.build(scene)
    reading = tanks.Reading(sim)
    tanks.run(sim, 0.5 * SECONDS)
    reading.read()
    tanks.run(sim, 0.5 * SECONDS, reading)
    return figures(ERRORS, reading)


TABLES = {
    "speed": Table(
        f"Speed and errors of `{SCENE}`, rocking, simulation only",
        ("method",),
        {(setup,): partial(speed, setup) for setup in SETUPS},
        forms(SPEEDS),
    ),
    "errors": Table(
        f"Errors of `{SCENE}` at rest, over the second half of {SECONDS:g} s",
        ("method",),
        {(setup,): partial(errors, setup) for setup in SETUPS},
        forms(ERRORS),
    ),
}
BENCHES = {
    "methods": Bench(
        "Classic and projection method in the deep pool",
        "Medians (least to largest) over the starts.\n",
        TABLES,
    )
}
