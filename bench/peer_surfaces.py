"""Surfaces: ours beside those of splashsurf, scikit-image and PyMCubes.

From particles: our surface of a collapsing block, whose particles the simulation has sorted into
its grid, and that of splashsurf (Loeschner et al. 2023) without any smoothing, at equal cells.
From a field: marching cubes on the same 128^3 numbers. Only ours and scikit-image's have normals.
"""

import importlib
import importlib.metadata
import importlib.util
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import taichi as ti

from bench.peer_tank import Tank
from bench.tanks import FRAME, GRAVITY
from msph.device import start
from msph.fluid.external_forces import ExternalForces
from msph.fluid.simulation import Simulation
from msph.scene.build import build_simulation
from msph.surface import Surface, SurfaceMesh, SurfaceRoom
from msph.surface.lattice import Lattice
from msph.surface.marching_cubes import MarchingCubes

# Modules of the peers, and the packages that bring them.
PACKAGES = {"pysplashsurf": "pysplashsurf", "skimage": "scikit-image", "mcubes": "PyMCubes"}
# Edges of cells, in radii of particles: 1.5 is what our scenes have.
CELLS = (1.5, 1.0)
# Smoothing length of splashsurf, in radii, and its threshold (-), as its guide has them.
SMOOTHING_LENGTH, THRESHOLD = 2.0, 0.6
# Simulated time [s] after which the block's surface is taken: its front runs.
COLLAPSED = 0.25
# Nodes along each edge of the field.
NODES = 128
# The field: a ball of this radius and waves of this height, in edges of the field, so many round.
RADIUS, WAVE, WAVES = 0.35, 0.04, 6
# Vertices and triangles that our mesh of the field has room for.
ROOM = 400_000


@dataclass(frozen=True)
class Way:
    """One way to a surface: its name, the work to be timed, and the triangles it makes."""

    name: str
    work: Callable[[], object]
    triangles: Callable[[], int]


def missing() -> list[str]:
    """Packages of peers that are not installed."""
    return [name for module, name in PACKAGES.items() if not importlib.util.find_spec(module)]


def versions() -> str:
    """Peers that are installed, in words."""
    found = [name for name in PACKAGES.values() if name not in missing()]
    return ", ".join(f"{name} {importlib.metadata.version(name)}" for name in found)


def measured(tank: Tank, rounds: int, arch: str) -> dict[str, dict[str, tuple[int, list[float]]]]:
    """By surface and way to it: triangles, and times [ms] of the rounds, in which all take turns.

    tank: the block whose surface is taken.
    """
    start(arch)
    found = {}
    sim = collapsed(tank)
    for cell in CELLS:
        name = f"{sim.particles.count:,} particles, cells of {cell:g} radii"
        found[name] = in_turns(from_particles(sim, cell), rounds)
    found[f"field of {NODES}^3 nodes"] = in_turns(from_field(field()), rounds)
    return found


def in_turns(ways: list[Way], rounds: int) -> dict[str, tuple[int, list[float]]]:
    """Triangles, and times [ms], of each way; the first round compiles and is not counted."""
    times: dict[str, list[float]] = {way.name: [] for way in ways}
    for turn in range(rounds + 1):
        for way in ways:
            ti.sync()
            begin = time.perf_counter()
            way.work()
            ti.sync()
            times[way.name] += [1e3 * (time.perf_counter() - begin)] if turn else []
    return {way.name: (way.triangles(), times[way.name]) for way in ways}


def collapsed(tank: Tank) -> Simulation:
    """Uniform water of the tank after a while."""
    sim = build_simulation(tank.scene(1))
    for _ in range(round(COLLAPSED / FRAME)):
        sim.advance(FRAME, ExternalForces(gravity=(0.0, -GRAVITY, 0.0)))
    return sim


def from_particles(sim: Simulation, cell: float) -> list[Way]:
    """Ways from the particles, at cells of `cell` radii."""
    d = sim.layers.finest.spacing
    edge = 0.5 * cell * d
    room = SurfaceRoom.holding(sim.size, edge, sim.particles.capacity)
    surface = Surface(sim.layers, sim.grid, sim.particles, None, room)
    surface.load(sim.size, edge)
    count = triangles(surface.mesh)

    def sorted_too() -> None:
        sim.grid.build()
        surface.extract()

    ways = [Way("ours", surface.extract, count), Way("ours, sort included", sorted_too, count)]
    if "pysplashsurf" not in missing():
        pysplashsurf = importlib.import_module("pysplashsurf")
        x, last = sim.particles.numpy("x"), []

        def reconstruct() -> None:
            last[:] = [
                pysplashsurf.reconstruct_surface(
                    x,
                    particle_radius=0.5 * d,
                    smoothing_length=SMOOTHING_LENGTH,
                    cube_size=cell,
                    iso_surface_threshold=THRESHOLD,
                )
            ]

        ways.append(Way("splashsurf", reconstruct, lambda: len(last[0].mesh.triangles)))
    return ways


def field() -> np.ndarray:
    """Distances, nearly, from a ball with waves, positive inside: (NODES, NODES, NODES) f32, in
    edges of the field."""
    x, y, z = (np.indices((NODES,) * 3) / (NODES - 1) - 0.5).astype(np.float32)
    k = 2.0 * np.pi * WAVES
    waves = WAVE * np.sin(k * x) * np.sin(k * y) * np.sin(k * z)
    return (RADIUS + waves - np.sqrt(x * x + y * y + z * z)).astype(np.float32)


def from_field(values: np.ndarray) -> list[Way]:
    """Ways from a field to its zero surface."""
    cubes, mesh = our_cubes(values)
    ways, last = [Way("ours", cubes.run, triangles(mesh))], {}

    def add(name: str, faces: Callable[[], np.ndarray]) -> None:
        def work() -> None:
            last[name] = faces()

        ways.append(Way(name, work, lambda: len(last[name])))

    absent = missing()
    if "pysplashsurf" not in absent:
        splash = importlib.import_module("pysplashsurf").marching_cubes
        options = {"iso_surface_threshold": 0.0, "cube_size": 1.0}
        add("splashsurf", lambda: splash(values, **options).triangles)
    if "scikit-image" not in absent:
        scikit = importlib.import_module("skimage.measure").marching_cubes
        add("scikit-image", lambda: scikit(values, 0.0)[1])
    if "PyMCubes" not in absent:
        mcubes = importlib.import_module("mcubes").marching_cubes
        add("PyMCubes", lambda: mcubes(values, 0.0)[1])
    return ways


def our_cubes(values: np.ndarray) -> tuple[MarchingCubes, SurfaceMesh]:
    """Marching cubes over all of a field and its slopes."""
    lattice = Lattice([np.arange(n) for n in values.shape])
    cubes = MarchingCubes(SurfaceRoom(values.size, vertices=ROOM, triangles=ROOM))
    cubes.load_field(lattice, values, np.stack(np.gradient(values), axis=-1))
    return cubes, cubes.mesh


def triangles(mesh: SurfaceMesh) -> Callable[[], int]:
    """Their number, once the mesh is made. Raises ValueError if they did not fit."""

    def count() -> int:
        if problem := mesh.overflowed():
            raise ValueError(problem)
        return int(mesh.counts.to_numpy()[1])

    return count
