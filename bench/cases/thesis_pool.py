"""The thesis's deeper pool at rest: its systems by its method, and the same water by ours."""

from bench import tanks
from bench.cases.case import Case, Run, Setting, begin
from msph.scene import load_scene
from msph.scene.schema import Scene

SCENE = "pool_2x"
SETTLE, READ = 2.0, 2.0
SYSTEMS = ("system-1", "system-2", "system-3")
# Spacings of the finest of system 3 in the depth: what all rows are said to have.
FINENESS = 20


def pool(setting: Setting) -> Scene:
    """The shipped scene, not rocked, with the setting's changes; without shear relief, which the
    scene has, unless the setting asks for it."""
    solver = {"shear_relief": 0.0, **setting.solver}
    changes = [f"variant={setting.water}", f"method={setting.method}", "sway.angle=0"]
    scene = load_scene(SCENE, changes + [f"projection.{k}={v:g}" for k, v in solver.items()])
    if setting.smoothing is None:
        return scene
    given = {"smoothing": setting.smoothing}
    layers = [layer.model_copy(update=given) for layer in scene.layers]
    return scene.model_copy(update={"layers": layers})


def measure(setting: Setting) -> tuple[Run, dict[str, float]]:
    run = begin(pool(setting))
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
