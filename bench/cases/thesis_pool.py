"""The thesis's deeper pool at rest: its systems by its method, and the same water by ours."""

from bench import tanks
from bench.cases.case import Case, Run, Setting, begin
from msph.scene import load_scene

SCENE = "pool_2x"
SETTLE, READ = 2.0, 2.0
SYSTEMS = ("system-1", "system-2", "system-3")
# Spacings of the finest of system 3 in the depth: what all rows are said to have.
FINENESS = 20


def measure(setting: Setting) -> tuple[Run, dict[str, float]]:
    changes = [f"variant={setting.water}", f"method={setting.method}", "sway.angle=0"]
    run = begin(load_scene(SCENE, changes))
    run.go(SETTLE)
    reading = tanks.Reading(run.simulation)
    run.go(READ, reading.read)
    return run, {
        "pressure": reading.pressure_error(),
        "height": abs(reading.volume_error()),
        "energy_rise": reading.energy_rise(),
    }


CASE = Case(
    "thesis_pool",
    "The thesis's deeper pool (2x) at rest, its own particles",
    "depth",
    {
        "pressure": "mean pressure of particles in sheets against rho g (H - y), rms, over rho g H",
        "height": "height of the centre of mass against H/2, over H/2",
        "energy_rise": "largest rise of the energy in 1 s, over that of the water above the floor",
    },
    (FINENESS,),
    measure,
    waters=(*SYSTEMS, "adaptive"),
    classic=SYSTEMS,
)
