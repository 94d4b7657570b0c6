"""Still water 1 m deep after stirring: pressure rho g (H - y), height and energy.

The water is stirred first, with several seeds: on the initial lattice all kernel sums are equal and
pressures are too accurate; in disordered water the errors vary with the seed.
"""

import numpy as np

from bench import tanks
from bench.cases.case import Case, Run, Setting, begin, stir, tank

FOOTPRINT, DEPTH, AIR = (0.5, 0.5), 1.0, 0.3
SETTLE, READ = 1.0, 2.0
STARTS = 4


def measure(setting: Setting) -> tuple[Run, dict[str, float]]:
    """Runs the case; returns the run and its errors."""
    run = begin(tank(setting, FOOTPRINT, DEPTH, AIR))
    pressures, heights, rises = [], [], []
    for start in range(STARTS):
        run.simulation.reset()
        stir(run, SETTLE, start)
        reading, profile = tanks.Reading(run.simulation), tanks.Profile(run.simulation, DEPTH)
        reading.read()

        def read(reading=reading, profile=profile) -> None:
            reading.read()
            profile.read()

        run.go(READ, read)
        pressures.append(profile.error())
        heights.append(reading.volume_error())
        rises.append(reading.energy_rise())
    return run, {
        "pressure": float(np.sqrt(np.mean(np.square(pressures)))),
        "height": float(np.sqrt(np.mean(np.square(heights)))),
        "energy_rise": max(rises),
    }


CASE = Case(
    "hydrostatic",
    "Still water, 1 m deep in a column of 0.5 m by 0.5 m",
    "depth",
    {
        "pressure": "pressure of probes against rho g (H - y), rms over depth and "
        f"{STARTS} seeds, over rho g H",
        "height": f"height of the centre of mass against H/2, rms over {STARTS} seeds, over H/2",
        "energy_rise": "largest rise of the energy in 1 s, over the potential energy",
    },
    (8, 12, 20, 32, 56),
    measure,
    sheared=True,
    summary=True,
)
