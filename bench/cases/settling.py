"""Water with random initial displacements comes to rest: height, bulk density, kinetic energy."""

from bench import tanks
from bench.cases.case import Case, Run, Setting, begin, tank

FOOTPRINT, DEPTH, AIR = (0.5, 0.5), 0.5, 0.3
# Range of the initial displacements, in spacings: the maximum of the parameter `jitter`.
JITTER = 0.5
SECONDS = 3.0


def measure(setting: Setting) -> tuple[Run, dict[str, float]]:
    """Runs the case; returns the run and its errors."""
    run = begin(setting, tank(setting, FOOTPRINT, DEPTH, AIR, jitter=JITTER))
    reading = tanks.Reading(run.water)
    run.go(SECONDS, reading.read)
    whole = 1000.0 * tanks.GRAVITY * DEPTH * DEPTH * FOOTPRINT[0] * FOOTPRINT[1]
    return run, {
        "height": abs(reading.volume_error()),
        "bulk_density": abs(run.water.bulk_density() - 1.0),
        "kinetic": reading.kinetic[-1] / whole,
        "energy_rise": reading.energy_rise(),
    }


CASE = Case(
    "settling",
    "Settling of irregularly placed water, 0.5 m deep, after 3 s",
    "depth",
    {
        "height": "height of the centre of mass against H/2, over H/2",
        "bulk_density": "bulk density against the rest density",
        "kinetic": "remaining kinetic energy, over M g H",
        "energy_rise": "largest rise of the energy in 1 s, over the potential energy",
    },
    (6, 9, 14, 20),
    measure,
)
