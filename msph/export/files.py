"""Files of meshes, points, particles and bodies for other programs: PLY, OBJ and CSV.

PLY files are binary. Their vertices have velocity_x, velocity_y and velocity_z [m/s], and foam, the
share of the surface that foam covers, or the radius [m] of a droplet. OBJ has no fields for them:
the velocity is in the place of a colour (`v x y z vx vy vz`), foam and layer in that of texture
coordinates (`vt foam layer`).
"""

from pathlib import Path
from typing import Any

import numpy as np

from msph.export import vtu
from msph.export.meshes import body_pose, shown_body, surface_arrays
from msph.fluid.boundary.body_faces import faces
from msph.fluid.simulation import Simulation
from msph.measure.table import Table, column
from msph.own_files import writing
from msph.picture.tone import CLAY, albedo
from msph.scene.bodies import names
from msph.stage.show import Show

PARAVIEW = ".vtu"


def write_mesh(path: Path, show: Show, layer: bool = False) -> None:
    """Writes the surface mesh in the format of the suffix; layer: with the layer of each vertex,
    which .vtu files always have."""
    display, suffix = show.display, path.suffix.lower()
    given = display.surface.mesh, show.simulation, display.whitewater
    if suffix == PARAVIEW:
        vtu.write_surface(path, *given)
        return
    vertices, normals, triangles, arrays = surface_arrays(*given, layer)
    if suffix == ".ply":
        write_ply(path, vertices, {"n": normals, **arrays}, triangles)
    else:
        flat = [arrays["foam"], arrays.get("layer", np.zeros(len(vertices)))]
        rows = {"v": np.hstack([vertices, arrays["velocity"]]), "vt": np.column_stack(flat)}
        corners = np.repeat(triangles[:, :, None] + 1, 3, axis=2).reshape(-1, 9)
        with open(path, "w", encoding="ascii") as file:
            for key, values in {**rows, "vn": normals}.items():
                np.savetxt(file, values, f"{key}" + " %.7g" * values.shape[1])
            np.savetxt(file, corners, "f %d/%d/%d %d/%d/%d %d/%d/%d")


def write_droplets(path: Path, show: Show) -> None:
    """Writes the droplets of the spray as points with their radii [m] and velocities [m/s]."""
    x, radius, v = show.display.surface.thin.spray.droplets()
    arrays = {"radius": radius, "velocity": v}
    if path.suffix.lower() == PARAVIEW:
        named = {"radius_m": radius, "velocity_m_per_s": v}
        vtu.write_points(path, x, named, show.simulation.time)
    else:
        write_ply(path, x, arrays)


def write_ply(
    path: Path, points: np.ndarray, arrays: dict[str, np.ndarray], triangles: Any = None
) -> None:
    """Writes points (n, 3) with arrays, (n,) or (n, 3), and triangles (t, 3), if any."""
    columns = {k: points[:, i] for i, k in enumerate("xyz")}
    for name, values in arrays.items():
        # Readers know normals as nx, ny and nz.
        parts = [f"{name}{'' if name == 'n' else '_'}{k}" for k in "xyz"]
        columns |= dict(zip(parts, values.T, strict=True)) if values.ndim == 2 else {name: values}
    table = np.zeros(len(points), [(name, "<f4") for name in columns])
    for name, values in columns.items():
        table[name] = values
    head = ["ply", "format binary_little_endian 1.0", "comment SI units, y up"]
    head += [f"element vertex {len(table)}", *(f"property float {name}" for name in columns)]
    faces = np.zeros(0 if triangles is None else len(triangles), [("n", "u1"), ("t", "<i4", 3)])
    if triangles is not None:
        faces["n"], faces["t"] = 3, triangles
        head += [f"element face {len(faces)}", "property list uchar int vertex_indices"]
    text = "\n".join([*head, "end_header", ""])
    path.write_bytes(text.encode("ascii") + table.tobytes() + faces.tobytes())


def write_particles(path: Path, show: Show) -> None:
    """Writes the particles in the format of the suffix."""
    suffix = path.suffix.lower()
    if suffix == PARAVIEW:
        vtu.write_particles(path, show.simulation)
    elif suffix == ".npz":
        state: dict[str, Any] = show.simulation.state()
        np.savez_compressed(path, **state)
    else:
        _write_csv(path, show)


def _write_csv(path: Path, show: Show) -> None:
    """Writes all carried attributes of the particles as columns with a header."""
    columns, heads = [], []
    for name, attribute in show.simulation.particles.attributes.items():
        if attribute.carried:
            values = show.simulation.particles.numpy(name)
            columns.append(values.reshape(len(values), -1))
            parts = [f"{name}_{k}" for k in "xyz"] if attribute.width == 3 else [name]
            heads += [column(f"{part} [{attribute.unit}]") for part in parts]
    np.savetxt(path, np.hstack(columns), delimiter=",", header=",".join(heads), comments="")


def body_looks(show: Show) -> list[tuple[str, list[tuple[str, Any, np.ndarray]]]]:
    """Returns the name of each body of the scene, and its materials: name, reflected share of light
    (linear RGB), and indices of its faces."""
    given = {f"bodies.{k}": b.colour for k, b in enumerate(show.scene.bodies)}
    given |= {b.name: b.colour for b in show.scene.bodies}
    looks = []
    for b, name in enumerate(names(show.scene)):
        body = shown_body(show.simulation, b)
        paint = getattr(body, "paint", None)
        if paint is None:
            paint = np.array([CLAY if given.get(name) is None else albedo(given[name])])
        colours, of_face = np.unique(paint, axis=0, return_inverse=True)
        if len(colours) == 1:
            of_face = np.zeros(len(faces(body).faces), int)
        parts = [np.flatnonzero(of_face.ravel() == k) for k in range(len(colours))]
        own = [name, *[f"{name}_{k}" for k in range(1, len(colours))]]
        looks.append((name, list(zip(own, colours, parts, strict=True))))
    return looks


class BodyFiles:
    """Bodies as an .obj file at time zero with materials (.mtl), and a table (.csv) of a row per
    frame and body: time [s], frame, body, and the rows m00 to m23 of the matrix that moves the
    vertices of the file to their place [m]."""

    def __init__(self, path: Path, show: Show):
        obj, mtl, csv = self.files(path)
        self.simulation: Simulation = show.simulation
        looks, first = body_looks(show), 1
        lines, materials = [f"mtllib {mtl.name}"], list[str]()
        for b, (name, own) in enumerate(looks):
            mesh = faces(shown_body(self.simulation, b))
            lines += [f"o {name}"]
            lines += ["v {:.7g} {:.7g} {:.7g}".format(*x) for x in mesh.vertices]
            for material, colour, part in own:
                lines += [f"usemtl {material}"]
                lines += ["f {} {} {}".format(*corners) for corners in mesh.faces[part] + first]
                materials += [f"newmtl {material}", "Kd {:.4g} {:.4g} {:.4g}".format(*colour)]
            first += len(mesh.vertices)
        for file, text in ((obj, lines), (mtl, materials)):
            with writing(file):
                file.write_text("\n".join([*text, ""]), encoding="utf-8")
        cells = [f"m{row}{k}" for row in range(3) for k in range(4)]
        self.table = Table(csv, ["time [s]", "frame [-]", "body [-]", *cells])
        self.count = len(looks)

    @staticmethod
    def files(path: Path) -> list[Path]:
        """Returns the files of an output `path`."""
        return [path, path.with_suffix(".mtl"), path.with_suffix(".csv")]

    def add(self, frame: int) -> None:
        """Writes the rows of a frame, given by its number."""
        for b in range(self.count):
            turn, at, start = body_pose(self.simulation, b)
            matrix = np.column_stack([turn, at - turn @ start])
            self.table.write([self.simulation.reached, frame, b, *matrix.ravel().tolist()])
