"""Mesh files of bodies and containers: search, reading, and check that they are closed."""

import io
import math
import os
import re
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from msph.errors import did_you_mean
from msph.scene.library import assets

SUFFIXES = (".obj", ".ply", ".stl")
# Largest number of characters of a file name in a message.
MAX_NAME = 80
# Sizes in a binary STL file [bytes]: header with the number of triangles, and a triangle.
STL_HEADER, STL_TRIANGLE = 84, 50
# Least volume of a mesh, as a share of the volume of its bounding box.
MIN_VOLUME_SHARE = 1e-6


class MeshError(ValueError):
    """A mesh file that cannot be used; str() gives the file and the reason."""


def resolve(name: str, folder: Path) -> str:
    """Returns the path of a file in `folder`, the folder of the scene file, if the file exists;
    otherwise the name unchanged, which is a path or a shipped mesh."""
    beside = folder / name
    return str(beside.resolve()) if os.path.isfile(beside) else name


def find_mesh(name: str) -> Path:
    """Returns the file of a mesh given by path or shipped name. Raises MeshError."""
    shipped = {p.name: p for k in SUFFIXES for p in sorted((assets() / "bodies").glob(f"*{k}"))}
    path = shipped.get(name, Path(name))
    if path.suffix.lower() not in SUFFIXES:
        known = ", ".join(SUFFIXES)
        raise MeshError(f"{path.name[:MAX_NAME]}: unknown mesh format; known: {known}")
    # os.path.isfile is False for names that are too long, where Path.is_file raises.
    if not os.path.isfile(path):
        hint = did_you_mean(name, shipped, "shipped")
        raise MeshError(f"{name[:MAX_NAME]}: no such mesh file; {hint}")
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
        check_counts(path, read)
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
    triangles, vertices = np.array(mesh.faces), np.array(mesh.vertices)
    if mesh.volume < 0.0:
        triangles = triangles[:, ::-1]
    parts = trimesh.graph.connected_components(mesh.face_adjacency, nodes=np.arange(len(triangles)))
    check_parts([vertices[triangles[part]] for part in parts], path.name)
    return vertices, triangles


def check_parts(parts: list[np.ndarray], name: str) -> None:
    """Raises MeshError if a part of a mesh, corners (t, 3, 3), is inside out and is not a cavity of
    another part."""
    for k, part in enumerate(parts):
        if np.linalg.det(part).sum() >= 0.0:
            continue
        if sum(turns(other, part[0, 0]) for m, other in enumerate(parts) if m != k) < 0.5:
            raise MeshError(f"{name}: body {k + 1} of {len(parts)} is inside out")


def turns(triangles: np.ndarray, point: np.ndarray) -> float:
    """Returns how often a closed surface, corners (t, 3, 3), encloses a point: the sum of the solid
    angles of its triangles over 4 pi (van Oosterom and Strackee 1983, eq. 8)."""
    a, b, c = (triangles[:, k] - point for k in range(3))
    la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
    ab, bc, ca = ((u * v).sum(axis=1) for u, v in ((a, b), (b, c), (c, a)))
    volume = (a * np.cross(b, c)).sum(axis=1)
    return float(np.arctan2(volume, la * lb * lc + ab * lc + bc * la + ca * lb).sum() / (2 * np.pi))


def check_counts(path: Path, mesh: Any) -> None:
    """Raises MeshError if a .ply file holds fewer vertices or faces than its header declares."""
    if path.suffix.lower() != ".ply":
        return
    header = path.read_bytes().partition(b"end_header")[0].decode("latin-1")
    declared = dict(re.findall(r"element\s+(vertex|face)\s+(\d+)", header))
    held = {"vertex": ("vertices", len(mesh.vertices)), "face": ("faces", len(mesh.faces))}
    for element, (word, count) in held.items():
        if count < int(declared.get(element, 0)):
            problem = f"declares {declared[element]} {word}, and holds {count}"
            raise MeshError(f"{path.name}: {problem}")


def source(path: Path) -> tuple[Any, dict[str, Any]]:
    """Returns the input and the options of trimesh.load. Names and comments may have any encoding:
    .obj files are read as Latin-1, and other bytes beyond ASCII in text are replaced by "?". Raises
    MeshError for .obj vertices that are not finite, which trimesh would drop with their triangles.
    """
    kind = path.suffix.lower().removeprefix(".")
    if kind == "obj":
        return obj_text(path), {"file_type": kind, "skip_materials": True}
    content = path.read_bytes()
    if kind == "ply":
        # Of a binary file, only the header is text.
        end = content.find(b"end_header")
        text = len(content) if b"ascii" in content[: max(end, 0)] else end
    else:
        count = int.from_bytes(content[STL_HEADER - 4 : STL_HEADER], "little")
        text = 0 if len(content) == STL_HEADER + count * STL_TRIANGLE else len(content)
    plain = content[:text].decode("ascii", "replace").replace("\ufffd", "?").encode()
    return io.BytesIO(plain + content[text:]), {"file_type": kind}


def obj_text(path: Path) -> io.StringIO:
    """Returns the text of an .obj file. Raises MeshError for vertices that are not finite."""
    text = path.read_text(encoding="latin-1")
    for number, line in enumerate(text.splitlines(), 1):
        kind, *numbers = line.split() or [""]
        if kind == "v" and not all(math.isfinite(float(x)) for x in numbers[:3]):
            raise MeshError(f"{path.name}: line {number}: vertex is not finite")
    return io.StringIO(text)
