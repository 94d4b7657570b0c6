"""pySPlisHSPlasH's DFSPH (Bender and Koschier 2015) on a block of water in a tank.

Its wheel contains its own libGLdispatch, with which the import crashes on some systems unless the
library of the system is loaded first (Debian: apt-get install libglvnd0 libgl1 libglu1-mesa).

Observations of version 2.19:
- A step computes densities from the positions at its start, and positions change at its end. The
  densities after a step therefore belong to the positions before it.
- Walls act at a distance of about one spacing. A regular block half a spacing from the walls has
2.4
  times the rest density there and explodes. The shipped scenes start two spacings from the walls,
  and so does this one.
"""

import contextlib
import ctypes
import importlib
import importlib.metadata
import importlib.util
import json
import os
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from bench.peer_tank import BULK_EVERY, BULK_FROM, Run, Tank, inner_bulk
from bench.tanks import FRAME, GRAVITY

MODULE = "pysplishsplash"
DISPATCH = "libGLdispatch.so.0"
# Initial distance from the block to the walls in spacings: see above.
START_GAP = 2.0
# Walls: corners of a unit cube about the origin, and its faces counter-clockwise from outside.
CORNERS = [(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]
FACES = (
    *((1, 2, 4), (1, 4, 3), (5, 7, 8), (5, 8, 6), (1, 5, 6), (1, 6, 2)),
    *((3, 4, 8), (3, 8, 7), (1, 3, 7), (1, 7, 5), (2, 6, 8), (2, 8, 4)),
)
# Enumerations of its scene files: DFSPH, volume maps (Bender et al. 2019), step by the Courant
# number, "Standard" viscosity.
DFSPH, VOLUME_MAPS, COURANT, STANDARD = 4, 2, 1, 1
# The following settings are those of the shipped scene DamBreakModel.json. Longest time step [s]:
LONGEST_STEP = 0.005
# Factor of the distance of 0.4 spacings per step (-), viscosity [m^2/s].
CFL_FACTOR, VISCOSITY = 1.0, 0.01
# Solver settings; tolerances in % of the rest density.
SOLVER = {
    "minIterations": 2,
    "maxIterations": 100,
    "maxError": 0.05,
    "maxIterationsV": 100,
    "maxErrorV": 0.1,
    "enableDivergenceSolver": True,
}
# Cell of the volume map of the walls, in spacings.
MAP_CELL = 2.0


def missing() -> bool:
    """Returns True if pySPlisHSPlasH is not installed."""
    return importlib.util.find_spec(MODULE) is None


def load() -> Any:
    """Imports and returns its module, after the system's libGLdispatch if there is one."""
    with contextlib.suppress(OSError):
        ctypes.CDLL(DISPATCH, mode=ctypes.RTLD_GLOBAL)
    return importlib.import_module(MODULE)


def write_scene(folder: Path, tank: Tank) -> Path:
    """Writes the scene file and the mesh of the walls to a folder; returns the path of the file."""
    lines = [f"v {x} {y} {z}" for x, y, z in CORNERS] + [f"f {a} {b} {c}" for a, b, c in FACES]
    (folder / "walls.obj").write_text("\n".join(lines) + "\n")
    d = tank.spacing
    # The first particles are half a spacing from the walls of the tank.
    behind = (START_GAP - 0.5) * d
    scene = {
        "Configuration": {
            "particleRadius": 0.5 * d,
            "simulationMethod": DFSPH,
            "gravitation": [0.0, -GRAVITY, 0.0],
            "timeStepSize": LONGEST_STEP,
            "cflMethod": COURANT,
            "cflFactor": CFL_FACTOR,
            "cflMaxTimeStepSize": LONGEST_STEP,
            "boundaryHandlingMethod": VOLUME_MAPS,
            "DFSPH": SOLVER,
        },
        "Materials": [
            {
                "id": "Fluid",
                "density0": 1000,
                "viscosityMethod": STANDARD,
                "Standard viscosity": {"viscosity": VISCOSITY},
            }
        ],
        "RigidBodies": [
            {
                "geometryFile": "walls.obj",
                "translation": [0.5 * length for length in tank.size],
                "scale": [length + 2.0 * behind for length in tank.size],
                "isDynamic": False,
                "isWall": True,
                "mapInvert": True,
                "mapThickness": 0.0,
                "mapResolution": [round(length / (MAP_CELL * d)) for length in tank.size],
            }
        ],
        # n particles are placed in n + 1 spacings, the first one spacing from the lower corner.
        "FluidBlocks": [
            {
                "denseMode": 0,
                "start": [-0.5 * d] * 3,
                "end": [(n + 0.5) * d for n in tank.counts],
            }
        ],
    }
    path = folder / "scene.json"
    path.write_text(json.dumps(scene))
    return path


@dataclass
class Watch:
    """Times and measures the steps after the first; its own work is not timed."""

    module: Any
    tank: Tank
    found: Run = field(default_factory=Run)
    begin: float = 0.0
    resumed: float = 0.0
    before: np.ndarray | None = None
    frames: int = 0

    def __post_init__(self):
        self.simulation = self.module.Simulation.getCurrent()
        self.model = self.simulation.getFluidModel(0)
        self.volume = self.model.getVolume(0)

    def read(self, name: str) -> np.ndarray:
        """Returns a field of the active particles; the buffer has room for emitted ones."""
        values = np.array(self.model.getFieldBuffer(name), dtype=float)
        return values[: self.model.numActiveParticles()]

    def step(self) -> None:
        """Called after each step."""
        now, at = time.perf_counter(), self.module.TimeManager.getCurrent().getTime()
        if self.begin:
            self.found.wall += now - self.resumed
            self.found.simulated = at - self.begin
            self.found.steps += 1
            self.found.iterations += self.simulation.getTimeStep().getNumIterations()
        else:
            self.begin, self.found.particles_start = at, self.model.numActiveParticles()
        if self.before is not None:
            self.measure()
        # Densities at the current positions are known after the next step.
        self.before = None
        if at >= self.frames * FRAME:
            self.before = self.read("position")
            self.frames += 1
        self.found.particles_end = self.model.numActiveParticles()
        self.resumed = time.perf_counter()

    def measure(self) -> None:
        """Measures compression and bulk density at the positions before the last step."""
        excess = np.maximum(self.read("density") / self.model.getDensity0() - 1.0, 0.0)
        self.found.compression.append(float(excess.mean()))
        if self.frames % BULK_EVERY == 0 and self.found.simulated >= BULK_FROM:
            spacing = np.full(len(self.before), self.volume ** (1.0 / 3.0))
            self.found.bulk.append(inner_bulk(self.before, spacing, self.tank.size))


def settings(module: Any) -> str:
    """Returns the settings of the current run in words."""
    sim = module.Simulation.getCurrent()
    step, model = sim.getTimeStep(), sim.getFluidModel(0)
    spacing = 2.0 * sim.getParticleRadius()
    number, whole = sim.getValueFloat, step.getValueUInt
    return (
        f"version {importlib.metadata.version(MODULE)}, volume maps (Bender et al. 2019); cubic "
        f"spline, support {sim.getSupportRadius() / spacing:.3g} spacings; a particle holds "
        f"{model.getVolume(0) / spacing**3:.3g} spacings^3; dt <= "
        f"{number(sim.CFL_MAX_TIMESTEPSIZE):.3g} s and {0.4 * number(sim.CFL_FACTOR):.3g} spacings "
        f"of the fastest particle; mean density error <= {step.getValueFloat(step.MAX_ERROR):.3g} "
        f"% in {whole(step.MIN_ITERATIONS)} to {whole(step.MAX_ITERATIONS)} iterations, divergence "
        f"error <= {step.getValueFloat(step.MAX_ERROR_V):.3g} % in at most "
        f"{whole(step.MAX_ITERATIONS_V)}; viscosity {VISCOSITY:g} m^2/s; walls "
        f"{START_GAP:g} spacings from the block; threads: "
        f"{os.environ.get('OMP_NUM_THREADS', os.cpu_count())}, OMP_WAIT_POLICY "
        f"{os.environ.get('OMP_WAIT_POLICY', 'unset')}"
    )


def run(tank: Tank, seconds: float, folder: Path) -> Run:
    """Runs the tank for `seconds` [s] without timing the first step. folder: for the map of the
    walls."""
    module = load()
    folder.mkdir(parents=True, exist_ok=True)
    scene = write_scene(folder, tank)
    base = module.Exec.SimulatorBase()
    with tempfile.TemporaryDirectory() as output:
        options = {"useGui": False, "initialPause": False, "outputDir": output}
        base.init(sceneFile=str(scene), stopAt=seconds, **options)
        base.initSimulation()
        watch = Watch(module, tank)
        base.setTimeStepCB(watch.step)
        base.runSimulation()
    watch.found.settings = settings(module)
    return watch.found
