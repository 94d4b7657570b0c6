"""The deeper pool of the thesis at rest, with its three systems, by both methods."""

from bench import tanks
from bench.cases.case import Case, Run, Setting, begin
from msph.scene import load_scene
from msph.scene.schema import Scene

SCENE = "pool_2x"
SETTLE, READ = 2.0, 2.0
SYSTEMS = ("system-1", "system-2", "system-3")
# Depth in finest spacings of system 3, given for all rows.
RESOLUTION = 20


def pool(setting: Setting) -> Scene:
    """Returns the shipped scene without rocking, with the setting's changes."""
    changes = [
        f"seed={setting.start}",
        f"variant={setting.water}",
        f"method={setting.method}",
        "sway.angle=0",
    ]
    scene = load_scene(
        SCENE, changes + [f"projection.{k}={v:g}" for k, v in setting.solver.items()]
    )
    if setting.smoothing is None:
        return scene
    given = {"smoothing": setting.smoothing}
    layers = [layer.model_copy(update=given) for layer in scene.layers]
    return scene.model_copy(update={"layers": layers})


def measure(setting: Setting) -> tuple[Run, dict[str, float]]:
    """Runs the case; returns the run and its errors."""
    run = begin(setting, pool(setting))
    run.go(SETTLE)
    reading = tanks.Reading(run.water)
    run.go(READ, reading.read)
    return run, {
        "pressure": reading.pressure_error(),
        "height": abs(reading.volume_error()),
        "energy_rise": reading.energy_rise(),
    }


CASE = Case(
    "thesis_pool",
    "The deeper pool (2x) of the thesis at rest, with its particles",
    "depth",
    {
        "pressure": "mean pressure in horizontal slices against rho g (H - y), rms, over rho g H",
        "height": "height of the centre of mass against H/2, over H/2",
        "energy_rise": "largest rise of the energy in 1 s, over the potential energy",
    },
    (RESOLUTION,),
    measure,
    kinds=(*SYSTEMS, "adaptive"),
    classic=SYSTEMS,
)
