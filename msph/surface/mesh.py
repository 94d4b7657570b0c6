"""The surface mesh: preallocated Taichi fields that are refilled every frame."""

from pathlib import Path

import numpy as np
import taichi as ti

from msph.taichi_internals import data_oriented, kernel


@data_oriented
class SurfaceMesh:
    """An indexed triangle mesh of fixed capacity.

    vertices (max_vertices,) 3-vector f32 [m]; normals, same shape, unit, out of the water;
    triangles (max_triangles,) 3-vector i32, counter-clockwise seen from outside;
    counts (4,) i32: vertices, triangles, wanted vertices, wanted triangles. The first two never
    exceed the capacity, and no triangle below counts[1] refers to a vertex that was dropped.
    """

    def __init__(self, max_vertices: int, max_triangles: int):
        self.max_vertices = max_vertices
        self.max_triangles = max_triangles
        self.vertices = ti.Vector.field(3, ti.f32, shape=max_vertices)
        self.normals = ti.Vector.field(3, ti.f32, shape=max_vertices)
        self.triangles = ti.Vector.field(3, ti.i32, shape=max_triangles)
        self.counts = ti.field(ti.i32, shape=4)

    def to_numpy(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Live vertices (v, 3) [m], normals (v, 3) and triangles (t, 3)."""
        v, t = self.counts.to_numpy()[:2]
        vertices, normals = np.zeros((2, v, 3), np.float32)
        triangles = np.zeros((t, 3), np.int32)
        if v > 0:
            self._read(vertices, normals, triangles)
        return vertices, normals, triangles

    @kernel
    def _read(
        self,
        vertices: ti.types.ndarray(dtype=ti.f32, ndim=2),
        normals: ti.types.ndarray(dtype=ti.f32, ndim=2),
        triangles: ti.types.ndarray(dtype=ti.i32, ndim=2),
    ):
        for i in range(vertices.shape[0]):
            for k in ti.static(range(3)):
                vertices[i, k], normals[i, k] = self.vertices[i][k], self.normals[i][k]
        for i in range(triangles.shape[0]):
            for k in ti.static(range(3)):
                triangles[i, k] = self.triangles[i][k]

    def overflowed(self) -> str | None:
        """What did not fit in the last extraction, in words, or None."""
        wanted = self.counts.to_numpy()[2:]
        parts = [
            f"{n} {name} wanted, {most} fit"
            for n, name, most in zip(
                wanted,
                ("vertices", "triangles"),
                (self.max_vertices, self.max_triangles),
                strict=True,
            )
            if n > most
        ]
        return "surface mesh overflow: " + "; ".join(parts) if parts else None

    def corners(self) -> np.ndarray:
        """Corner positions of the live triangles, (t, 3, 3) f64 [m]."""
        vertices, _, triangles = self.to_numpy()
        return vertices.astype(np.float64)[triangles]

    def area(self) -> float:
        """Surface area [m^2]."""
        a, b, c = self.corners().transpose(1, 0, 2)
        return 0.5 * float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())

    def volume(self) -> float:
        """Enclosed volume [m^3]: the sum of the tetrahedra over the origin, a.(b x c)/6."""
        a, b, c = self.corners().transpose(1, 0, 2)
        return float(np.einsum("ti,ti->", a, np.cross(b, c))) / 6.0

    def export(self, path: str | Path) -> None:
        """Write the live mesh with its normals; .ply or .obj by the file's suffix."""
        import trimesh  # only exports need it, and it takes a while to load

        vertices, normals, triangles = self.to_numpy()
        mesh = trimesh.Trimesh(vertices, triangles, vertex_normals=normals, process=False)
        suffix = Path(path).suffix.lower()
        if suffix == ".ply":
            mesh.export(path, vertex_normal=True)
        elif suffix == ".obj":
            mesh.export(path, include_normals=True)
        else:
            raise ValueError(f"cannot export to '{suffix}': use .ply or .obj")
