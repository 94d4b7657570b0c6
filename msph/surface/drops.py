"""Drops: particles without neighbours, added to the mesh as spheres of their volume.

Marching cubes would make polyhedra of them, since a drop is hardly larger than a cell.
"""

import taichi as ti

from msph.device_table import DeviceTable, i32
from msph.surface.mesh import SurfaceMesh
from msph.surface.sphere import sphere
from msph.surface.thin_water import ThinWater
from msph.taichi_internals import data_oriented, kernel

vec3 = ti.math.vec3


@data_oriented
class Drops:
    """Adds the drops that `thin` found to a mesh.

    begin, of the drops in the mesh: first vertex and first triangle; fit: number of drops that the
    mesh has room for.
    """

    def __init__(self, mesh: SurfaceMesh, thin: ThinWater):
        self.mesh, self.thin = mesh, thin
        vertices, triangles = sphere()
        self.vertices, self.triangles = len(vertices), len(triangles)
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
            x, edge = self.thin.particles.x[p], self.thin.spacing(p)
            v = self.numbers.first_vertex[None] + k * self.vertices
            for m in range(self.vertices):
                from_centre = self.sphere.vertex[m]
                self.mesh.vertices[v + m] = x + edge * from_centre
                self.mesh.normals[v + m] = from_centre.normalized()
            t = self.numbers.first_triangle[None] + k * self.triangles
            for m in range(self.triangles):
                self.mesh.triangles[t + m] = v + self.sphere.triangle[m]
