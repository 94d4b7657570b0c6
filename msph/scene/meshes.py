"""Mesh files of obstacles and containers: found, read, and checked to enclose a volume."""

import io
import math
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from msph.errors import did_you_mean
from msph.scene.library import assets

KINDS = (".obj", ".ply", ".stl")
# Volume below which a mesh counts as flat, as a share of its bounds' volume.
FLAT = 1e-6


class MeshError(ValueError):
    """A mesh file that cannot be used; str() says why, and names the file."""


def resolve(name: str, folder: Path) -> str:
    """The mesh file of that name beside a scene file in `folder`; else the name as it is, which
    stands for a file by its path, or a shipped one."""
    beside = folder / name
    return str(beside.resolve()) if beside.is_file() else name


def find_mesh(name: str) -> Path:
    """The file of a mesh given by path or shipped name. Raises MeshError."""
    shipped = {p.name: p for k in KINDS for p in sorted((assets() / "obstacles").glob(f"*{k}"))}
    path = shipped.get(name, Path(name))
    if path.suffix.lower() not in KINDS:
        raise MeshError(f"{path.name}: unknown kind of mesh; known: {', '.join(KINDS)}")
    if not path.is_file():
        hint = did_you_mean(name, shipped, "shipped")
        raise MeshError(f"{name}: no such mesh file; {hint}")
    return path


@lru_cache(maxsize=16)
def load_mesh(name: str) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (v, 3) and triangles (t, 3), counter-clockwise seen from outside, of a mesh file.

    Raises MeshError for a file that cannot be read or that encloses no volume.
    """
    import trimesh  # only meshes need it, and it takes a while to load

    path = find_mesh(name)
    try:
        text, how = source(path)
        read: Any = trimesh.load(text, force="mesh", **how)
        # Corners that a file keeps apart for their normals or colours are one place.
        mesh = trimesh.Trimesh(read.vertices, read.faces, process=True)
        mesh.update_faces(mesh.nondegenerate_faces())
    except MeshError:
        raise
    except Exception as error:  # every reader of every kind has errors of its own
        raise MeshError(f"{path.name}: is no mesh: {first_line(error)}") from None
    if len(mesh.faces) == 0:
        raise MeshError(f"{path.name}: has no triangles")
    if not np.all(np.isfinite(mesh.vertices)):
        raise MeshError(f"{path.name}: has vertices that are not finite")
    shared = np.unique(mesh.edges_sorted, axis=0, return_counts=True)[1]
    if np.any(shared == 1):
        raise MeshError(f"{path.name}: is not closed: {int((shared == 1).sum())} open edges")
    if np.any(shared > 2) or not mesh.is_winding_consistent:
        raise MeshError(f"{path.name}: does not tell inside from outside: its faces disagree")
    if abs(mesh.volume) <= FLAT * float(np.prod(mesh.extents)):
        raise MeshError(f"{path.name}: encloses no volume")
    triangles = np.array(mesh.faces)
    return np.array(mesh.vertices), triangles if mesh.volume > 0.0 else triangles[:, ::-1]


def source(path: Path) -> tuple[Any, dict[str, Any]]:
    """What trimesh shall read, and how. Texts may hold comments in old encodings, of which Latin-1
    reads any; and its reader drops vertices that are not finite, and their triangles: MeshError."""
    if path.suffix.lower() != ".obj":
        return path, {}
    text = path.read_text(encoding="latin-1")
    for number, line in enumerate(text.splitlines(), 1):
        kind, *numbers = line.split() or [""]
        if kind == "v" and not all(math.isfinite(float(x)) for x in numbers[:3]):
            raise MeshError(f"{path.name}: line {number}: a vertex that is not finite")
    return io.StringIO(text), {"file_type": "obj", "skip_materials": True}


def first_line(error: Exception) -> str:
    lines = str(error).strip().splitlines()
    return lines[0] if lines else type(error).__name__
