"""Still water in a column 1 m deep: pressure rho g (H - y), and rest."""

from bench import tanks
from bench.cases.case import Case, Run, Setting, begin, tank

FOOTPRINT, DEPTH, AIR = (0.5, 0.5), 1.0, 0.3
SETTLE, READ = 1.0, 2.0


def measure(setting: Setting) -> tuple[Run, dict[str, float]]:
    run = begin(tank(setting, FOOTPRINT, DEPTH, AIR))
    run.go(SETTLE)
    reading, profile = tanks.Reading(run.simulation), tanks.Profile(run.simulation, DEPTH)
    reading.read()

    def read() -> None:
        reading.read()
        profile.read()

    run.go(READ, read)
    return run, {
        "pressure": profile.error(),
        "height": abs(reading.volume_error()),
        "energy_rise": reading.energy_rise(),
    }


CASE = Case(
    "hydrostatic",
    "Still water, 1 m deep in a column of 0.5 m by 0.5 m",
    "depth",
    {
        "pressure": "pressure read by probes against rho g (H - y), rms over depth, over rho g H",
        "height": "height of the centre of mass against H/2, over H/2",
        "energy_rise": "largest rise of the energy in 1 s, over that of the water above the floor",
    },
    (8, 12, 20, 32, 56),
    measure,
    sheared=True,
    summary=True,
)
