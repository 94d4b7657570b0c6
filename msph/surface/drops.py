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


def sphere() -> tuple[np.ndarray, np.ndarray]:
    """Returns the vertices (42, 3) and the triangles (80, 3), counter-clockwise from outside, of a
    mesh around the origin that encloses the volume 1: an icosahedron with the middles of its edges.
    Distances from the origin vary by 1.3 % (rms)."""
    golden = (1.0 + np.sqrt(5.0)) / 2.0
    side = [(0.0, a, b * golden) for a, b in itertools.product((-1.0, 1.0), repeat=2)]
    corners = np.concatenate([np.roll(side, shift, axis=1) for shift in range(3)])
    pairs = np.argwhere(neighbours(corners, 2.0))
    vertices = np.concatenate([corners, corners[pairs].mean(axis=1)])
    vertices /= np.linalg.norm(vertices, axis=1)[:, None]
    # The triangles are all triples of neighbours: edges have 0.55 or 0.62 radii, diagonals 1.
    near = neighbours(vertices, 0.7)
    faces = np.argwhere(near[:, :, None] & near[:, None] & near)
    volumes = np.linalg.det(vertices[faces]) / 6.0
    faces[volumes < 0.0] = faces[volumes < 0.0, ::-1]
    return vertices / np.cbrt(abs(volumes).sum()), faces


def neighbours(x: np.ndarray, distance: float) -> np.ndarray:
    """Returns True for pairs i < j of the points x (n, 3) within a distance, (n, n)."""
    return np.triu(np.linalg.norm(x[:, None] - x, axis=2) < 1.001 * distance, 1)
