"""Particles and surface as VTK's unstructured grids (.vtu), which ParaView opens.

Every point has arrays in SI units, the unit in the name: velocity_m_per_s, pressure_Pa, layer,
density_error (rho/rho0 - 1 at the present positions; below zero where the kernel meets air) and
spacing_m, by which ParaView's point gaussians and glyphs get their sizes.
"""

import importlib.util
from pathlib import Path
from typing import Any

import numpy as np

from msph.fluid.simulation import Simulation
from msph.measure.host_kernels import wendland
from msph.measure.table import column

# Particles of a layer that tell the values at a vertex: those of half a kernel's ball, the rest is
# air.
NEAREST = 40


def available() -> bool:
    """Whether the library that writes them is installed."""
    return importlib.util.find_spec("meshio") is not None


def write_particles(path: Path, simulation: Simulation) -> None:
    """A vertex for each particle."""
    x, arrays = _particles(simulation)
    cells = [("vertex", np.arange(len(x))[:, None])]
    _write(path, x, cells, arrays)


def write_surface(path: Path, mesh, simulation: Simulation) -> None:
    """The mesh's triangles with their normals, and what the particles round each vertex have: means
    weighed by V_j W(r_j, h_j) (Shepard 1968), the layer of the nearest."""
    vertices, normals, triangles = mesh.to_numpy()
    arrays = {"normal": normals}
    if len(vertices):
        arrays |= _at(vertices, simulation)
    _write(path, vertices, [("triangle", triangles)], arrays)


def _particles(simulation: Simulation) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Positions [m] and the arrays of all particles."""
    simulation.measure_density()
    p, specs = simulation.particles, simulation.layers.specs
    layer = p.numpy("layer")
    rest = np.array([s.density for s in specs])[layer]
    arrays = {
        "velocity [m/s]": p.numpy("v"),
        "pressure [Pa]": p.numpy("pressure"),
        "density_error [-]": p.numpy("density") / rest - 1.0,
        "spacing [m]": np.array([s.spacing for s in specs])[layer],
        "layer [-]": layer,
    }
    return p.numpy("x"), {column(head): values for head, values in arrays.items()}


def _at(points: np.ndarray, simulation: Simulation) -> dict[str, np.ndarray]:
    """The arrays at `points` (p, 3) [m]."""
    # Here, since only this needs it, and it is slow to import.
    from scipy.spatial import cKDTree

    x, arrays = _particles(simulation)
    support = np.array([s.support for s in simulation.layers.specs])[arrays["layer"]]
    # By layers: among fine particles coarse ones that reach a point are not its nearest.
    found_r, found_near = [], []
    for layer in np.unique(arrays["layer"]):
        own = np.flatnonzero(arrays["layer"] == layer)
        some_r, some = cKDTree(x[own]).query(points, k=min(NEAREST, len(own)))
        found_r.append(some_r.reshape(len(points), -1))
        found_near.append(own[some].reshape(len(points), -1))
    r, near = np.hstack(found_r), np.hstack(found_near)
    order = r.argsort(axis=1)
    r, near = np.take_along_axis(r, order, 1), np.take_along_axis(near, order, 1)
    weight = arrays["spacing_m"][near] ** 3 * wendland(r, support[near])
    # Beyond every kernel the nearest speaks alone.
    weight[:, 0] += np.where(weight.sum(axis=1) > 0.0, 0.0, 1.0)
    weight /= weight.sum(axis=1, keepdims=True)
    found = {}
    for name, values in arrays.items():
        if name == "layer":
            found[name] = values[near[:, 0]]
        else:
            found[name] = np.einsum("pk,pk...->p...", weight, values[near])
    return found


def _write(path: Path, points: np.ndarray, cells: list, arrays: dict[str, np.ndarray]) -> None:
    import meshio  # an optional dependency

    data: dict[str, Any] = {
        name: np.ascontiguousarray(values, np.int32 if name == "layer" else np.float32)
        for name, values in arrays.items()
    }
    meshio.Mesh(points.astype(np.float32), cells, point_data=data).write(path)
