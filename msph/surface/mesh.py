"""Surface mesh in preallocated Taichi fields that are refilled every frame."""

import numpy as np
import taichi as ti

from msph.launches import data_oriented, kernel


@data_oriented
class SurfaceMesh:
    """Indexed triangle mesh of fixed capacity.

    vertices (max_vertices,) 3-vector f32 [m]; normals, same shape, unit vectors out of the water;
    triangles (max_triangles,) 3-vector i32, counter-clockwise from outside; counts (4,) i32:
    vertices, triangles, required vertices, required triangles. The first two never exceed the
    capacity, and no triangle below counts[1] refers to a dropped vertex.
    """

    def __init__(self, max_vertices: int, max_triangles: int):
        self.max_vertices = max_vertices
        self.max_triangles = max_triangles
        self.vertices = ti.Vector.field(3, ti.f32, shape=max_vertices)
        self.normals = ti.Vector.field(3, ti.f32, shape=max_vertices)
        self.triangles = ti.Vector.field(3, ti.i32, shape=max_triangles)
        self.counts = ti.field(ti.i32, shape=4)

    def to_numpy(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Returns the valid vertices (v, 3) [m], normals (v, 3) and triangles (t, 3)."""
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
        """Returns a message if the last mesh exceeded the capacity, otherwise None."""
        names, most = ("vertices", "triangles"), (self.max_vertices, self.max_triangles)
        needed = zip(self.counts.to_numpy()[2:], names, most, strict=True)
        parts = [f"{n} {name} needed, {fit} fit" for n, name, fit in needed if n > fit]
        return "surface mesh overflow: " + "; ".join(parts) if parts else None

    def volume(self) -> float:
        """Computes the enclosed volume [m^3]: sum of the tetrahedra to the origin, a.(b x c)/6."""
        vertices, _, triangles = self.to_numpy()
        a, b, c = vertices.astype(np.float64)[triangles].transpose(1, 0, 2)
        return float(np.einsum("ti,ti->", a, np.cross(b, c))) / 6.0
