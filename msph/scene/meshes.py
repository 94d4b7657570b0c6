"""Mesh files of bodies and containers: search, reading, colours, and check that they are closed."""

import io
import math
import os
import re
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from msph.errors import BadInputError, did_you_mean
from msph.kept_arrays import kept
from msph.picture.tone import CLAY, albedo
from msph.scene.library import assets

SUFFIXES = (".obj", ".ply", ".stl")
# Largest number of characters of a file name in a message.
MAX_NAME = 80
# Sizes in a binary STL file [bytes]: header with the number of triangles, and a triangle.
STL_HEADER, STL_TRIANGLE = 84, 50
# Least volume of a mesh, as a share of the volume of its bounding box.
MIN_VOLUME_SHARE = 1e-6


class MeshError(BadInputError):
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
def load_mesh(name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Returns vertices (v, 3) and triangles (t, 3) of a mesh file, counter-clockwise from outside,
    and the albedos of the triangles (t, 3), linear RGB, or None for a file without colours.

    Raises MeshError if the file cannot be read, lacks a material or does not enclose a volume.
    """
    path = find_mesh(name)
    files = [path, library_of(path)]
    content = [f.read_bytes() if f and os.access(f, os.R_OK) else b"" for f in files]
    vertices, triangles, albedos = kept(partial(_read, path), "mesh", path.name, *content)
    return vertices, triangles, albedos if len(albedos) else None


def _read(path: Path) -> list[np.ndarray]:
    """Returns load_mesh() of a file, with an empty array for a file without colours."""
    import trimesh  # 0.4 s to import, and only meshes need it

    try:
        text, how = source(path)
        scene: Any = trimesh.load(text, force="scene", **how)
        read = list(scene.geometry.values())
        check_counts(path, read)
        albedos = albedos_of(path, read)
        bare = [trimesh.Trimesh(part.vertices, part.faces, process=False) for part in read]
        mesh: Any = trimesh.util.concatenate(bare) if bare else trimesh.Trimesh()
        # Vertices that the file repeats for different normals or colours.
        mesh.merge_vertices(merge_tex=True, merge_norm=True)
        used = mesh.nondegenerate_faces()
        mesh.update_faces(used)
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
    return [vertices, triangles, np.zeros((0, 3)) if albedos is None else albedos[used]]


def albedos_of(path: Path, parts: list[Any]) -> np.ndarray | None:
    """Returns the albedos (t, 3), linear RGB, of the triangles of the parts of a mesh file, by
    their materials, or None if no part has a colour. Diffuse colours of materials (Kd) are linear,
    colours of vertices and faces sRGB. Raises MeshError for materials that are not defined."""
    check_materials(path)
    if all(part.visual.kind is None for part in parts):
        return None
    found = []
    for part in parts:
        colours = np.tile(CLAY, (len(part.faces), 1))
        if part.visual.kind == "texture":
            colours[:] = part.visual.material.main_color[:3] / 255.0
        elif part.visual.kind is not None:
            colours[:] = albedo(part.visual.face_colors[:, :3] / 255.0)
        found.append(colours)
    return np.concatenate(found)


def check_materials(path: Path) -> None:
    """Raises MeshError if an .obj file names a library of materials that is not there, or that
    lacks one of its materials."""
    library = library_of(path)
    used = entries(path.read_text(encoding="latin-1"), "usemtl") if library else []
    if library and used:
        if not os.path.isfile(library):
            raise MeshError(f"{path.name}: has materials, but there is no file {library.name}")
        defined = entries(library.read_text(encoding="latin-1"), "newmtl")
        missing = [name for name in used if name not in defined]
        if missing:
            hint = did_you_mean(missing[0], defined, "known")
            raise MeshError(f"{path.name}: material {missing[0]} is not in {library.name}; {hint}")


def library_of(path: Path) -> Path | None:
    """Returns the file of materials that an .obj file names, which may not exist, or None."""
    if path.suffix.lower() != ".obj" or not os.access(path, os.R_OK):
        return None
    library = entries(path.read_text(encoding="latin-1"), "mtllib")
    return path.with_name(Path(library[0]).name) if library else None


def entries(text: str, keyword: str) -> list[str]:
    """Returns what follows a keyword in the lines of an .obj or .mtl file."""
    return re.findall(rf"^{keyword}[ \t]+(.*\S)", text, re.MULTILINE)


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


def check_counts(path: Path, parts: list[Any]) -> None:
    """Raises MeshError if a .ply file holds fewer vertices or faces than its header declares."""
    if path.suffix.lower() != ".ply":
        return
    header = path.read_bytes().partition(b"end_header")[0].decode("latin-1")
    declared = dict(re.findall(r"element\s+(vertex|face)\s+(\d+)", header))
    vertices, faces = (sum(len(getattr(p, k)) for p in parts) for k in ("vertices", "faces"))
    held = {"vertex": ("vertices", vertices), "face": ("faces", faces)}
    for element, (word, count) in held.items():
        if count < int(declared.get(element, 0)):
            problem = f"declares {declared[element]} {word}, and holds {count}"
            raise MeshError(f"{path.name}: {problem}")


def source(path: Path) -> tuple[Any, dict[str, Any]]:
    """Returns the input and the options of trimesh.load. Names and comments may have any encoding:
    .obj files are read as Latin-1, and other bytes beyond ASCII in text are replaced by "?". Raises
    MeshError for .obj vertices that are not finite, which trimesh would drop with their triangles.
    """
    from trimesh.resolvers import FilePathResolver

    kind = path.suffix.lower().removeprefix(".")
    if kind == "obj":
        return obj_text(path), {"file_type": kind, "resolver": FilePathResolver(str(path))}
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
