"""Drops: particles without neighbours, added to the mesh as spheres of their volume.

Marching cubes would turn drops into polyhedra, since a drop is hardly larger than a cell. A sphere
is an icosahedron whose triangles are divided into four. At a wall, the sphere touches the wall.
"""

import itertools

import numpy as np
import taichi as ti

from msph.device_table import DeviceTable, i32
from msph.launches import data_oriented, kernel
from msph.surface.mesh import SurfaceMesh
from msph.surface.thin_water import ThinWater

vec3 = ti.math.vec3


@data_oriented
class Drops:
    """Adds the drops that `thin` found to a mesh.

    numbers: first vertex and first triangle of the drops in the mesh; fit: number of drops that
    the mesh has room for.
    """

    def __init__(self, mesh: SurfaceMesh, thin: ThinWater):
        self.mesh, self.thin = mesh, thin
        vertices, triangles = sphere()
        self.vertices, self.triangles = len(vertices), len(triangles)
        self.radius = float(np.linalg.norm(vertices, axis=1).max())
        self.sphere = DeviceTable((self.triangles,), vertex=vec3, triangle=ti.math.ivec3)
        self.sphere.fill(vertex=vertices, triangle=triangles)
        self.numbers = DeviceTable((), first_vertex=i32, first_triangle=i32, fit=i32)

    @kernel
    def add(self):
        """Appends the spheres to the mesh."""
        ti.loop_config(serialize=True)
        for _ in range(1):
            mesh = self.mesh
            v, t = mesh.counts[0], mesh.counts[1]
            fit = ti.min((mesh.max_vertices - v) // self.vertices, self.thin.drop_count[None])
            fit = ti.min((mesh.max_triangles - t) // self.triangles, fit)
            self.numbers.first_vertex[None], self.numbers.first_triangle[None] = v, t
            self.numbers.fit[None] = fit
            mesh.counts[0], mesh.counts[1] = v + fit * self.vertices, t + fit * self.triangles
            mesh.counts[2] += self.thin.drop_count[None] * self.vertices
            mesh.counts[3] += self.thin.drop_count[None] * self.triangles
        for k in range(self.numbers.fit[None]):
            p = self.thin.drops[k]
            edge = self.thin.spacing(p) * self.thin.kept[p] ** (1.0 / 3.0)
            x = self.beside_walls(self.thin.particles.x[p], self.radius * edge)
            v = self.numbers.first_vertex[None] + k * self.vertices
            for m in range(self.vertices):
                from_centre = self.sphere.vertex[m]
                self.mesh.vertices[v + m] = x + edge * from_centre
                self.mesh.normals[v + m] = from_centre.normalized()
            t = self.numbers.first_triangle[None] + k * self.triangles
            for m in range(self.triangles):
                self.mesh.triangles[t + m] = v + self.sphere.triangle[m]

    @ti.func
    def beside_walls(self, x, radius):
        """Returns the centre [m] of a sphere for the particle at x that crosses no wall. A
        particle above an open top keeps its height."""
        highest = self.thin.numbers.size[None] - radius
        if x.y > highest.y + radius:
            highest.y = x.y
        return ti.math.clamp(x, radius, highest)


def icosahedron() -> tuple[np.ndarray, np.ndarray]:
    """Returns the vertices (12, 3) and the triangles (20, 3), counter-clockwise from outside."""
    golden = (1.0 + np.sqrt(5.0)) / 2.0
    face = [(0.0, a, b * golden) for a, b in itertools.product((-1.0, 1.0), repeat=2)]
    vertices = np.concatenate([np.roll(face, shift, axis=1) for shift in range(3)])
    distance = np.linalg.norm(vertices[:, None] - vertices, axis=2)
    edge = np.isclose(distance, 2.0)
    triples = itertools.combinations(range(len(vertices)), 3)
    faces = [t for t in triples if all(edge[p] for p in itertools.combinations(t, 2))]
    outward = [np.linalg.det(vertices[list(t)]) > 0.0 for t in faces]
    return vertices, np.array(
        [t if out else t[::-1] for t, out in zip(faces, outward, strict=True)]
    )


def divided(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns the mesh with each triangle (a, b, c) divided at the middles of its edges."""
    pairs = np.stack([faces, np.roll(faces, -1, axis=1)], axis=2)
    edges, inverse = np.unique(np.sort(pairs.reshape(-1, 2), axis=1), axis=0, return_inverse=True)
    ab, bc, ca = len(vertices) + inverse.reshape(-1, 3).T
    a, b, c = faces.T
    parts = [(a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca)]
    middles = vertices[edges].mean(axis=1)
    return np.concatenate([vertices, middles]), np.concatenate([np.stack(p, 1) for p in parts])


def sphere() -> tuple[np.ndarray, np.ndarray]:
    """Returns the vertices (42, 3) and the triangles (80, 3) of a mesh around the origin that
    encloses the volume 1. Distances from the origin vary by 1.3 % (rms)."""
    vertices, faces = divided(*icosahedron())
    vertices /= np.linalg.norm(vertices, axis=1)[:, None]
    a, b, c = vertices[faces].transpose(1, 0, 2)
    volume = np.einsum("ti,ti->", a, np.cross(b, c)) / 6.0
    return vertices / np.cbrt(volume), faces
