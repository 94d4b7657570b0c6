"""Particles, surface and bodies as VTK unstructured grids (.vtu) for ParaView, with their time, and
the .pvd file that lists them.

Point arrays have SI units in their names: velocity_m_per_s, pressure_Pa, layer, solver_residual
(rho/rho0 - 1 at the current positions; negative near air) and spacing_m, for the size of ParaView's
point gaussians and glyphs.
"""

from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from msph.export.meshes import body_mesh, foam_at, interpolated
from msph.fluid.simulation import Simulation
from msph.measure.body_table import QUANTITIES
from msph.measure.table import column
from msph.own_files import replacing
from msph.surface.mesh import SurfaceMesh
from msph.surface.whitewater import Whitewater


def write_particles(path: Path, simulation: Simulation) -> None:
    """Writes the particles as vertex cells."""
    write_points(path, *_particles(simulation), simulation.reached)


def write_points(path: Path, x: np.ndarray, arrays: dict[str, np.ndarray], time: float) -> None:
    """Writes points (n, 3) [m] with arrays at a time [s] as vertex cells."""
    _write(path, x, [("vertex", np.arange(len(x))[:, None])], arrays, time)


def write_surface(
    path: Path, mesh: SurfaceMesh, simulation: Simulation, white: Whitewater | None
) -> None:
    """Writes the mesh with normals, the share of foam, and the particles' values at its vertices
    (meshes.py)."""
    vertices, normals, triangles = mesh.to_numpy()
    arrays = {"normal": normals} | interpolated(vertices, simulation, _particles(simulation)[1])
    arrays["foam"] = foam_at(vertices, white, max(simulation.size))
    _write(path, vertices, [("triangle", triangles)], arrays, simulation.time)


def write_bodies(path: Path, simulation: Simulation, numbers: np.ndarray) -> None:
    """Writes the faces of all bodies, with the index of the body, the velocity of the vertex, and
    the other numbers of BodyTable.numbers(), which are equal for all vertices of a body."""
    points, triangles, owner = [np.zeros((0, 3))], [np.zeros((0, 3), int)], [np.zeros(0, int)]
    for b in range(simulation.boundary.count):
        mesh = body_mesh(simulation, b)
        triangles.append(mesh.faces + sum(map(len, points)))
        points.append(mesh.vertices)
        owner.append(np.full(len(mesh.vertices), b))
    x, which = np.concatenate(points), np.concatenate(owner)
    parts = np.split(numbers[which], len(QUANTITIES), axis=1)
    of_body = dict(zip(QUANTITIES, parts, strict=True))
    of_body["velocity"] = of_body["velocity"] + np.cross(of_body["spin"], x - of_body["position"])
    arrays = {column(f"{name} [{QUANTITIES[name]}]"): part for name, part in of_body.items()}
    cells = [("triangle", np.concatenate(triangles))]
    _write(path, x, cells, {"body": which} | arrays, simulation.reached)


def write_list(path: Path, files: list[tuple[float, Path]]) -> None:
    """Writes a .pvd file of (time [s], .vtu file) in the same folder, which ParaView opens as one
    data set that changes with time."""
    root = ElementTree.Element("VTKFile", type="Collection", version="0.1")
    listed = ElementTree.SubElement(root, "Collection")
    for time, file in files:
        ElementTree.SubElement(listed, "DataSet", timestep=f"{time:.9g}", file=file.name)
    ElementTree.indent(root)
    with replacing(path) as new:
        ElementTree.ElementTree(root).write(new, encoding="utf-8", xml_declaration=True)


def _particles(simulation: Simulation) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Returns the positions (n, 3) [m] and the arrays of all particles."""
    simulation.measure_density()
    p, specs = simulation.particles, simulation.layers.specs
    layer = p.numpy("layer")
    rest = np.array([s.density for s in specs])[layer]
    arrays = {
        "velocity [m/s]": p.numpy("v"),
        "pressure [Pa]": p.numpy("pressure"),
        "solver_residual [-]": p.numpy("density") / rest - 1.0,
        "spacing [m]": np.array([s.spacing for s in specs])[layer],
        "layer [-]": layer,
    }
    return p.numpy("x"), {column(head): values for head, values in arrays.items()}


def _write(
    path: Path, points: np.ndarray, cells: list, arrays: dict[str, np.ndarray], time: float
) -> None:
    import meshio  # slow to import

    data: dict[str, Any] = {
        name: np.ascontiguousarray(values, np.int32 if values.dtype.kind == "i" else np.float32)
        for name, values in arrays.items()
    }
    meshio.Mesh(points.astype(np.float32), cells, point_data=data).write(path)
    # meshio has no way to write the time that ParaView shows.
    tree = ElementTree.parse(path)
    grid = tree.find("UnstructuredGrid")
    assert grid is not None
    field = ElementTree.Element("FieldData")
    form = {"type": "Float64", "Name": "TimeValue", "NumberOfTuples": "1", "format": "ascii"}
    ElementTree.SubElement(field, "DataArray", form).text = f"{time:.9g}"
    grid.insert(0, field)
    tree.write(path)
