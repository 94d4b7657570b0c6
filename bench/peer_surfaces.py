"""Comparison of surfaces: ours, splashsurf, scikit-image and PyMCubes.

From particles: our surface of a collapsing block, whose particles are already sorted into the grid
of the simulation, and the surface by splashsurf (Loeschner et al. 2023) without smoothing, with
equal cells. From a field: marching cubes on the same 128^3 values. Only ours and scikit-image
compute normals.
"""

import importlib
import importlib.metadata
import importlib.util
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from bench import tanks
from bench.cases import block
from bench.cases.case import Setting
from bench.tables import Bench, Table
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
# Timed rounds, and target: speed-up over the fastest other program.
ROUNDS, TARGET = 20, 5.0
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


def other(name: str, faces: Callable[[], Any]) -> Method:
    """Returns the method of another program; faces() returns the triangles."""
    return Method(name, faces, lambda: len(faces()))


def missing() -> list[str]:
    """Returns the packages that are not installed."""
    return [name for module, name in PACKAGES.items() if not importlib.util.find_spec(module)]


def versions() -> str:
    """Returns names and versions of the installed packages."""
    found = [name for name in PACKAGES.values() if name not in missing()]
    return ", ".join(f"{name} {importlib.metadata.version(name)}" for name in found)


def measured(start: int) -> list[dict[str, Any]]:
    """Returns a row for each surface and method: number of triangles, and times [ms]."""
    sim = collapsed(start)
    surfaces = {
        f"{sim.particles.count:,} particles, cells of {cell:g} radii": from_particles(sim, cell)
        for cell in CELLS
    }
    surfaces[f"field of {NODES}^3 nodes"] = from_field(field())
    return [row for name, methods in surfaces.items() for row in in_turns(name, methods)]


def in_turns(surface: str, methods: list[Method]) -> list[dict[str, Any]]:
    """Returns the rows of a surface."""
    times = tanks.in_turns({method.name: method.work for method in methods}, ROUNDS)
    middle = {name: float(np.median(found)) for name, found in times.items()}
    fastest = min((t for n, t in middle.items() if not n.startswith("ours")), default=np.nan)
    return [
        {
            "surface": surface,
            "program": method.name,
            "triangles": method.triangles(),
            "ms": middle[method.name],
            "least ms": min(times[method.name]),
            "largest ms": max(times[method.name]),
            "speed-up over the fastest other": fastest / middle[method.name],
        }
        for method in methods
    ]


def collapsed(start: int) -> Simulation:
    """Returns the simulation of a collapsing block of uniform water at COLLAPSED."""
    sim = build_simulation(block.tank(Setting(resolution=27, start=start)))
    tanks.run(sim, COLLAPSED)
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
        reconstruct = partial(
            pysplashsurf.reconstruct_surface,
            sim.particles.numpy("x"),
            particle_radius=0.5 * d,
            smoothing_length=SMOOTHING_LENGTH,
            cube_size=cell,
            iso_surface_threshold=THRESHOLD,
        )
        methods.append(other("splashsurf", lambda: reconstruct().mesh.triangles))
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
    methods, absent = [Method("ours", cubes.run, triangles(mesh))], missing()
    if "pysplashsurf" not in absent:
        splash = importlib.import_module("pysplashsurf").marching_cubes
        options = {"iso_surface_threshold": 0.0, "cube_size": 1.0}
        methods.append(other("splashsurf", lambda: splash(values, **options).triangles))
    if "scikit-image" not in absent:
        scikit = importlib.import_module("skimage.measure").marching_cubes
        methods.append(other("scikit-image", lambda: scikit(values, 0.0)[1]))
    if "PyMCubes" not in absent:
        mcubes = importlib.import_module("mcubes").marching_cubes
        methods.append(other("PyMCubes", lambda: mcubes(values, 0.0)[1]))
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


BENCHES = {
    "peers": Bench(
        "Surfaces by other programs",
        f"{versions()}; missing: {', '.join(missing()) or 'none'} (pip install '.[peers]').\n",
        {
            "surfaces": Table(
                f"Surfaces; target: {TARGET:g} times as fast as the fastest other program. Ours "
                "from particles sorted by the simulation; splashsurf without smoothing, smoothing "
                f"length {SMOOTHING_LENGTH:g} radii",
                (),
                {(): measured},
                {
                    "triangles": ",.0f",
                    "ms": ".3g",
                    "least ms": ".3g",
                    "largest ms": ".3g",
                    "speed-up over the fastest other": ".1f",
                },
                starts=1,
            )
        },
    )
}
