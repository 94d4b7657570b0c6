"""DFSPH (Bender and Koschier 2015) of pySPlisHSPlasH on the water of our scenes.

The wheel of pySPlisHSPlasH contains a libGLdispatch, with which the import crashes on some systems
unless the library of the system is loaded first (Debian: apt-get install libglvnd0 libgl1
libglu1-mesa).

Observations of version 2.19:
- A step computes densities from the positions at its start, and positions change at its end. The
  densities after a step therefore belong to the positions before it.
- Walls act at a distance of about one spacing. A regular block half a spacing from the walls has
  2.4 times the rest density there and explodes. The walls are therefore outside the box of the
  scene, at the distance with which still water has its level: see gap_of().
- Volume maps of cells of one or two spacings are inaccurate in narrow tanks: levels are up to 56 %
  too high.
"""

import contextlib
import ctypes
import importlib
import importlib.util
import json
import os
import sys
import tempfile
import threading
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from bench import rows, tanks
from bench.rows import RESULTS
from bench.water import GRAVITY, Water
from msph.measure.snapshot import Snapshot
from msph.scene.build import plan_of
from msph.scene.schema import Scene

MODULE = "pysplishsplash"
DISPATCH = "libGLdispatch.so.0"
# Initial distance from the particles to the walls in spacings: first guess, and corrections by the
# level of still water after LEVEL_SECONDS [s] in a tank of at most LEVEL_EDGE spacings a side.
GAP, GAP_ROUNDS, LEVEL_SECONDS, LEVEL_EDGE = 1.25, 4, 1.0, 12
# Enumerations of SPlisHSPlasH's scene files: DFSPH, volume maps (Bender et al. 2019), step by the
# Courant number, "Standard" viscosity.
DFSPH, VOLUME_MAPS, COURANT, STANDARD = 4, 2, 1, 1
# The following settings are those of the shipped scene DamBreakModel.json. Longest time step [s]:
LONGEST_STEP = 0.005
# Factor of the distance of 0.4 spacings per step (-), viscosity [m^2/s].
CFL_FACTOR, VISCOSITY = 1.0, 0.01
# Mean density error and divergence error in % of the rest density.
TOLERANCE, DIVERGENCE_OVER_TOLERANCE = 0.05, 2.0
SOLVER = {
    "minIterations": 2,
    "maxIterations": 100,
    "maxIterationsV": 100,
    "enableDivergenceSolver": True,
}
# Cell of the volume map of the walls, in spacings, and largest number of cells along an edge.
MAP_CELL, MOST_CELLS = 0.5, 40
# Particles of the smallest block.
LEAST_BLOCK = 8
# Folder of volume maps, which take seconds to minutes.
MAPS = Path(tempfile.gettempdir()) / "msph_peer_maps"
# Time limit of a process that measures a level [s].
MAX_SECONDS = 600
# Table of the gaps.
GAPS = RESULTS / "peer_gaps.csv"


def missing() -> bool:
    """Returns True if pySPlisHSPlasH is not installed."""
    return importlib.util.find_spec(MODULE) is None


def load() -> Any:
    """Imports and returns pySPlisHSPlasH, after the system's libGLdispatch if there is one."""
    # Threads that wait by spinning lose most of the speed if other processes run.
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")
    with contextlib.suppress(OSError):
        ctypes.CDLL(DISPATCH, mode=ctypes.RTLD_GLOBAL)
    return importlib.import_module(MODULE)


def gap_of(size: tuple[float, float, float], spacing: float) -> float:
    """Returns the distance of the walls from the initial particles, in spacings, with which still
    water has its level in a tank of `size` [m]; measured once and kept in a table."""
    edges = [min(edge, LEVEL_EDGE * spacing) for edge in (size[0], size[2])]
    across = [f"{edge / spacing:.3g}" for edge in edges]
    known = rows.read(GAPS)
    for row in known:
        if [row["along"], row["across"]] == across:
            return float(row["gap"])
    gap, depth, tried = GAP, LEVEL_EDGE * spacing, {}
    # Fall of the level per gap at constant volume, by two walls along each edge and by the floor.
    slope = spacing * (sum(2.0 / edge for edge in edges) + 1.0 / depth)
    for _ in range(GAP_ROUNDS):
        task = {"edges": edges, "depth": depth, "spacing": spacing, "gap": gap}
        tried[gap] = rows.in_process(__file__, task, MAX_SECONDS)["level"]
        if len(tried) > 1:
            (before, high), (now, low) = list(tried.items())[-2:]
            slope = max(0.5 * slope, (high - low) / (now - before))
        gap += (tried[gap] - 1.0) / slope
    gap = min(tried, key=lambda g: abs(tried[g] - 1.0))
    level = tried[gap]
    row = {"along": across[0], "across": across[1], "gap": f"{gap:.3f}", "level": f"{level:.4f}"}
    rows.write(GAPS, [*known, row])
    return gap


def level_of(edges: tuple[float, float], depth: float, spacing: float, gap: float) -> float:
    """Returns the level of still water over its level at rest density (-)."""
    water = Dfsph(tanks.tank(edges, depth, spacing, 1, air=0.5 * depth), gap)
    begun = water.positions()[:, 1].mean()
    water.advance(LEVEL_SECONDS)
    return float(water.positions()[:, 1].mean() / begun)


def blocks_of(number: int) -> list[tuple[int, int, int]]:
    """Returns the edges [particles] of one or two blocks with exactly `number` particles in total.

    SPlisHSPlasH ignores blocks with fewer than two particles along an edge, and sorts surplus,
    inactive particles among the active ones. Raises ValueError if there are no such blocks.
    """
    for second in (0, *range(LEAST_BLOCK, number)):
        found = [_edges(n) for n in (number - second, second) if n]
        if all(found):
            return found
    raise ValueError(f"{number} particles do not fill two blocks of two or more along each edge")


def _edges(number: int) -> tuple[int, int, int] | None:
    """Returns the edges, of two or more, of one block of `number` particles, or None."""
    for a in range(2, number):
        for b in range(2, number // a):
            if number % (a * b) == 0:
                return number // (a * b), a, b
    return None


class Dfsph(Water):
    """Water of a scene with one layer and no bodies, simulated by DFSPH.

    gap: distance of the walls from the initial particles in spacings, None: gap_of(). viscosity
    [m^2/s]; cfl: Courant factor (-); longest_step [s]; tolerance: mean density error in % of the
    rest density. A process can hold only one.
    """

    def __init__(
        self,
        scene: Scene,
        gap: float | None = None,
        viscosity: float = VISCOSITY,
        cfl: float = CFL_FACTOR,
        longest_step: float = LONGEST_STEP,
        tolerance: float = TOLERANCE,
    ):
        self.module = load()
        plan = plan_of(scene)
        self.size, self.spacing = plan.size, plan.specs[0].spacing
        self.viscosity, self.gap = viscosity, gap or gap_of(self.size, self.spacing)
        x = plan.initial["x"]
        self.steps, self.iterations, self._until, self.count = 0, 0, 0.0, len(x)
        self._go, self._done = threading.Semaphore(0), threading.Semaphore(0)
        MAPS.mkdir(exist_ok=True)
        with tempfile.TemporaryDirectory() as folder:
            path = self._write(len(x), cfl, longest_step, tolerance)
            self.base = self.module.Exec.SimulatorBase()
            options = {"useGui": False, "initialPause": False, "outputDir": f"{folder}/out"}
            self.base.init(sceneFile=str(path), stopAt=1e9, **options)
            self.base.initSimulation()
            path.unlink()
            self.base.setTimeStepCB(self._pause)
            # The loop of SPlisHSPlasH runs in a thread, which waits after each step.
            threading.Thread(target=self.base.runSimulation, daemon=True).start()
            self._done.acquire()
        self.simulation = self.module.Simulation.getCurrent()
        self.model = self.simulation.getFluidModel(0)
        self.clock = self.module.TimeManager.getCurrent()
        # The first step was made with blocks outside the box.
        self.restart(x, plan.initial.get("v", np.zeros_like(x)))

    def _write(self, n: int, cfl: float, longest: float, tolerance: float) -> Path:
        """Writes the scene file and the mesh of the walls; returns the path of the file."""
        trimesh.creation.box().export(MAPS / "walls.obj")  # a unit cube about the origin
        d, outside = self.spacing, 2.0 * max(self.size)
        solver = {**SOLVER, "maxError": tolerance}
        solver["maxErrorV"] = DIVERGENCE_OVER_TOLERANCE * tolerance
        scene = {
            "Configuration": {
                "particleRadius": 0.5 * d,
                "simulationMethod": DFSPH,
                "gravitation": [0.0, -GRAVITY, 0.0],
                "timeStepSize": longest,
                "cflMethod": COURANT,
                "cflFactor": cfl,
                "cflMaxTimeStepSize": longest,
                "boundaryHandlingMethod": VOLUME_MAPS,
                "DFSPH": solver,
            },
            "Materials": [
                {
                    "id": "Fluid",
                    "density0": 1000,
                    "viscosityMethod": STANDARD,
                    "Standard viscosity": {"viscosity": self.viscosity},
                }
            ],
            "RigidBodies": [
                {
                    "geometryFile": "walls.obj",
                    "translation": [0.5 * length for length in self.size],
                    "scale": [edge + 2.0 * (self.gap - 0.5) * d for edge in self.size],
                    "isDynamic": False,
                    "isWall": True,
                    "mapInvert": True,
                    "mapThickness": 0.0,
                    "mapResolution": [
                        min(MOST_CELLS, round(edge / (MAP_CELL * d))) for edge in self.size
                    ],
                }
            ],
            # k particles are placed in k + 1 spacings; a second block is above the first.
            "FluidBlocks": [
                {
                    "denseMode": 0,
                    "start": [outside, level * outside, outside],
                    "end": [
                        begin + (k + 1.0) * d
                        for begin, k in zip((outside, level * outside, outside), edges, strict=True)
                    ],
                }
                for level, edges in enumerate(blocks_of(n), start=1)
            ],
        }
        path = MAPS / f"scene_{os.getpid()}.json"
        path.write_text(json.dumps(scene))
        return path

    def _pause(self) -> None:
        """Pauses the loop of SPlisHSPlasH, which calls this after each step."""
        self._done.release()
        self._go.acquire()

    def _field(self, name: str) -> np.ndarray:
        """Returns a writable field of the active particles; the buffer of the field also has room
        for emitted particles."""
        values = np.array(self.model.getFieldBuffer(name), copy=False)
        return values[: self.model.numActiveParticles()]

    def restart(self, x: np.ndarray, v: np.ndarray) -> None:
        """Starts at time zero with particles at x [m] with velocities v [m/s], (n, 3)."""
        if len(self._field("position")) != len(x):
            raise ValueError(f"{len(self._field('position'))} particles instead of {len(x)}")
        self._field("position")[:], self._field("velocity")[:] = x, v
        for name in ("p / rho^2", "p_v / rho^2"):
            self._field(name)[:] = 0.0
        self.clock.setTime(0.0)
        self._until = 0.0

    time = property(lambda self: self.clock.getTime())

    def positions(self) -> np.ndarray:
        return self._field("position").astype(float)

    def velocities(self) -> np.ndarray:
        return self._field("velocity").astype(float)

    def spacings(self) -> np.ndarray:
        return np.full(self.count, self.model.getVolume(0) ** (1.0 / 3.0))

    def residuals(self) -> np.ndarray:
        density = self._field("density").astype(float)
        return np.maximum(density / self.model.getDensity0() - 1.0, 0.0)

    def pressures(self) -> None:
        return None

    def set_velocities(self, v: np.ndarray) -> None:
        self._field("velocity")[:] = v

    def snapshot(self) -> Snapshot:
        x, spacing = self.positions(), self.spacings()

        def free(points: np.ndarray, _: float) -> np.ndarray:
            return np.ones(len(points), bool)

        support, time = self.simulation.getSupportRadius() / self.spacing * spacing, self.time
        v = self.velocities()
        return Snapshot(x, None, spacing, support, self.size, free, v=v, time=time)

    def advance(self, seconds: float, gravity: float = GRAVITY) -> None:
        """Advances by whole steps, past the end of the frame if they do not end with it."""
        if gravity != GRAVITY:
            raise ValueError(f"gravity is {GRAVITY} m/s^2")
        self._until += seconds
        while self.time < self._until - 1e-9:
            self._go.release()
            self._done.acquire()
            self.steps += 1
            self.iterations += self.simulation.getTimeStep().getNumIterations()


if __name__ == "__main__":
    found = {"level": level_of(**json.loads(sys.argv[2]))}
    print(json.dumps(found), flush=True)
    os._exit(0)  # the thread of SPlisHSPlasH still runs
