"""Still water 1 m deep after stirring: pressure rho g (H - y), motion, height and energy.

The water is stirred first: on the initial lattice all kernel sums are equal and pressures are too
accurate; in disordered water the errors vary with the start.
"""

from typing import Any

from bench import tanks
from bench.cases.case import UNSHEARED, Case, Run, Setting, begin, stir, tank

FOOTPRINT, DEPTH, AIR = (0.5, 0.5), 1.0, 0.3
SETTLE, READ = 1.0, 2.0


def measure(setting: Setting) -> tuple[Run, dict[str, float]]:
    """Runs the case; returns the run and its errors."""
    run = begin(setting, tank(setting, FOOTPRINT, DEPTH, AIR))
    stir(run, SETTLE, setting.start)
    reading = tanks.Reading(run.water)
    ours = run.water.pressures() is not None
    readers: list[Any] = [reading, tanks.Profile(run.water, DEPTH)] if ours else [reading]
    reading.read()

    def read() -> None:
        for reader in readers:
            reader.read()

    run.go(READ, read)
    return run, {
        **({"pressure": readers[1].error()} if ours else {}),
        "motion": reading.motion(),
        "height": abs(reading.volume_error()),
        "energy_rise": reading.energy_rise(),
    }


CASE = Case(
    "hydrostatic",
    "Still water, 1 m deep in a column of 0.5 m by 0.5 m",
    "depth",
    {
        "pressure": "pressure of probes against rho g (H - y), rms over depth, over rho g H",
        "motion": f"rms speed {SETTLE + READ - 1:g} to {SETTLE + READ:g} s after stirring, over "
        "sqrt(g H)",
        "height": "height of the centre of mass against H/2, over H/2",
        "energy_rise": "largest rise of the energy in 1 s, over the potential energy",
    },
    (8, 12, 20, 32, 56),
    measure,
    varied=(UNSHEARED,),
    summary=("pressure", "motion"),
    peer=("motion", "height"),
)
