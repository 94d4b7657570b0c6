"""Comparison of surfaces: ours, splashsurf, scikit-image and PyMCubes.

From particles: our surface of a collapsing block, whose particles are already sorted into the grid
of the simulation, and the surface by splashsurf (Loeschner et al. 2023) without smoothing, with
equal cells. From a field: marching cubes on the same 128^3 values. Only ours and scikit-image
compute normals.
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

# Modules of the other programs, and the packages that contain them.
PACKAGES = {"pysplashsurf": "pysplashsurf", "skimage": "scikit-image", "mcubes": "PyMCubes"}
# Edges of the cells in particle radii: 1.5 is our default.
CELLS = (1.5, 1.0)
# Smoothing length of splashsurf in particle radii, and its threshold (-), from its documentation.
SMOOTHING_LENGTH, THRESHOLD = 2.0, 0.6
# Simulated time [s] at which the surface of the collapsing block is computed.
COLLAPSED = 0.25
# Nodes along each edge of the field.
NODES = 128
# The field: a ball with waves; radius and wave height over the edge of the field, number of waves.
RADIUS, WAVE, WAVES = 0.35, 0.04, 6
# Capacity of our mesh of the field: vertices, and triangles.
ROOM = 400_000


@dataclass(frozen=True)
class Method:
    """A method to compute a surface: name, timed work, and function that returns the number of
    triangles."""

    name: str
    work: Callable[[], object]
    triangles: Callable[[], int]


def missing() -> list[str]:
    """Returns the packages that are not installed."""
    return [name for module, name in PACKAGES.items() if not importlib.util.find_spec(module)]


def versions() -> str:
    """Returns names and versions of the installed packages."""
    found = [name for name in PACKAGES.values() if name not in missing()]
    return ", ".join(f"{name} {importlib.metadata.version(name)}" for name in found)


def measured(tank: Tank, rounds: int, arch: str) -> dict[str, dict[str, tuple[int, list[float]]]]:
    """Returns the number of triangles and the times [ms] of all rounds, by surface and method.

    tank: the block whose surface is computed. The methods run in alternating rounds.
    """
    start(arch)
    found = {}
    sim = collapsed(tank)
    for cell in CELLS:
        name = f"{sim.particles.count:,} particles, cells of {cell:g} radii"
        found[name] = in_turns(from_particles(sim, cell), rounds)
    found[f"field of {NODES}^3 nodes"] = in_turns(from_field(field()), rounds)
    return found


def in_turns(methods: list[Method], rounds: int) -> dict[str, tuple[int, list[float]]]:
    """Returns triangles and times [ms] by method; the first round, which compiles, is not timed."""
    times: dict[str, list[float]] = {method.name: [] for method in methods}
    for turn in range(rounds + 1):
        for method in methods:
            ti.sync()
            begin = time.perf_counter()
            method.work()
            ti.sync()
            times[method.name] += [1e3 * (time.perf_counter() - begin)] if turn else []
    return {method.name: (method.triangles(), times[method.name]) for method in methods}


def collapsed(tank: Tank) -> Simulation:
    """Returns the simulation of the tank with uniform water at COLLAPSED."""
    sim = build_simulation(tank.scene(1))
    for _ in range(round(COLLAPSED / FRAME)):
        sim.advance(FRAME, ExternalForces(gravity=(0.0, -GRAVITY, 0.0)))
    return sim


def from_particles(sim: Simulation, cell: float) -> list[Method]:
    """Returns the methods for particles, with cells of `cell` radii."""
    d = sim.layers.finest.spacing
    edge = 0.5 * cell * d
    room = SurfaceRoom.holding(sim.size, edge, sim.particles.capacity)
    surface = Surface(sim.layers, sim.grid, sim.particles, None, room)
    surface.load(sim.size, edge)
    count = triangles(surface.mesh)

    def sort_and_extract() -> None:
        sim.grid.build()
        surface.extract()

    methods = [
        Method("ours", surface.extract, count),
        Method("ours, sort included", sort_and_extract, count),
    ]
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

        methods.append(Method("splashsurf", reconstruct, lambda: len(last[0].mesh.triangles)))
    return methods


def field() -> np.ndarray:
    """Returns the approximate signed distance from a ball with waves, positive inside, over the
    edge of the field: (NODES, NODES, NODES) f32."""
    x, y, z = (np.indices((NODES,) * 3) / (NODES - 1) - 0.5).astype(np.float32)
    k = 2.0 * np.pi * WAVES
    waves = WAVE * np.sin(k * x) * np.sin(k * y) * np.sin(k * z)
    return (RADIUS + waves - np.sqrt(x * x + y * y + z * z)).astype(np.float32)


def from_field(values: np.ndarray) -> list[Method]:
    """Returns the methods for the zero surface of a field."""
    cubes, mesh = our_cubes(values)
    methods, last = [Method("ours", cubes.run, triangles(mesh))], {}

    def add(name: str, faces: Callable[[], np.ndarray]) -> None:
        def work() -> None:
            last[name] = faces()

        methods.append(Method(name, work, lambda: len(last[name])))

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
    return methods


def our_cubes(values: np.ndarray) -> tuple[MarchingCubes, SurfaceMesh]:
    """Returns our marching cubes for a field and its gradient."""
    lattice = Lattice([np.arange(n) for n in values.shape])
    cubes = MarchingCubes(SurfaceRoom(values.size, vertices=ROOM, triangles=ROOM))
    cubes.load_field(lattice, values, np.stack(np.gradient(values), axis=-1))
    return cubes, cubes.mesh


def triangles(mesh: SurfaceMesh) -> Callable[[], int]:
    """Returns a function that returns the number of triangles; it raises ValueError if the mesh is
    full."""

    def count() -> int:
        if problem := mesh.overflowed():
            raise ValueError(problem)
        return int(mesh.counts.to_numpy()[1])

    return count
