"""Mesh files of obstacles and containers: search, reading, and check that they are closed."""

import io
import math
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from msph.errors import did_you_mean
from msph.scene.library import assets

SUFFIXES = (".obj", ".ply", ".stl")
# Least volume of a mesh, as a share of the volume of its bounding box.
MIN_VOLUME_SHARE = 1e-6


class MeshError(ValueError):
    """A mesh file that cannot be used; str() gives the file and the reason."""


def resolve(name: str, folder: Path) -> str:
    """Returns the path of the mesh file if it exists in `folder`, the scene file's; else the name
    unchanged, which find_mesh() takes as a path or a shipped mesh."""
    beside = folder / name
    return str(beside.resolve()) if beside.is_file() else name


def find_mesh(name: str) -> Path:
    """Returns the file of a mesh given by path or shipped name. Raises MeshError."""
    shipped = {p.name: p for k in SUFFIXES for p in sorted((assets() / "obstacles").glob(f"*{k}"))}
    path = shipped.get(name, Path(name))
    if path.suffix.lower() not in SUFFIXES:
        raise MeshError(f"{path.name}: unknown mesh format; known: {', '.join(SUFFIXES)}")
    if not path.is_file():
        hint = did_you_mean(name, shipped, "shipped")
        raise MeshError(f"{name}: no such mesh file; {hint}")
    return path


@lru_cache(maxsize=16)
def load_mesh(name: str) -> tuple[np.ndarray, np.ndarray]:
    """Returns vertices (v, 3) and triangles (t, 3) of a mesh file, counter-clockwise from outside.

    Raises MeshError if the file cannot be read or does not enclose a volume.
    """
    import trimesh  # 0.4 s to import, and only meshes need it

    path = find_mesh(name)
    try:
        text, how = source(path)
        read: Any = trimesh.load(text, force="mesh", **how)
        # Merges vertices that the file repeats for different normals or colours.
        mesh = trimesh.Trimesh(read.vertices, read.faces, process=True)
        mesh.update_faces(mesh.nondegenerate_faces())
    except MeshError:
        raise
    except Exception as error:  # each of trimesh's readers has its own errors
        reason = (str(error).strip() or type(error).__name__).splitlines()[0]
        raise MeshError(f"{path.name}: is not a mesh: {reason}") from None
    if len(mesh.faces) == 0:
        raise MeshError(f"{path.name}: has no triangles")
    if not np.all(np.isfinite(mesh.vertices)):
        raise MeshError(f"{path.name}: has vertices that are not finite")
    shared = np.unique(mesh.edges_sorted, axis=0, return_counts=True)[1]
    if np.any(shared == 1):
        raise MeshError(f"{path.name}: is not closed: {int((shared == 1).sum())} open edges")
    if np.any(shared > 2) or not mesh.is_winding_consistent:
        raise MeshError(f"{path.name}: has no clear inside: its faces are inconsistently oriented")
    if abs(mesh.volume) <= MIN_VOLUME_SHARE * float(np.prod(mesh.extents)):
        raise MeshError(f"{path.name}: encloses no volume")
    triangles = np.array(mesh.faces)
    return np.array(mesh.vertices), triangles if mesh.volume > 0.0 else triangles[:, ::-1]


def source(path: Path) -> tuple[Any, dict[str, Any]]:
    """Returns the input and the options of trimesh.load. Comments of .obj files may have any
    encoding, so they are read as Latin-1. Raises MeshError for .obj vertices that are not finite,
    which trimesh would drop with their triangles."""
    if path.suffix.lower() != ".obj":
        return path, {}
    text = path.read_text(encoding="latin-1")
    for number, line in enumerate(text.splitlines(), 1):
        kind, *numbers = line.split() or [""]
        if kind == "v" and not all(math.isfinite(float(x)) for x in numbers[:3]):
            raise MeshError(f"{path.name}: line {number}: vertex is not finite")
    return io.StringIO(text), {"file_type": "obj", "skip_materials": True}
