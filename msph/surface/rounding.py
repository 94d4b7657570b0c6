"""Rounding: edges of the mesh whose ends have different normals are divided and curved.

In threads and drops of a few particles, which are hardly larger than the cells of marching cubes,
the mesh is a polyhedron. An edge from x_a to x_b, of length l, is divided at

    x = (x_a + x_b)/2 + s n,   s = (l/2) tan(alpha/2),   sin alpha = (n_b - n_a).(x_b - x_a)/(2 l),

with n the mean normal across the edge: the middle of a circular arc with these normals at its ends
(curved triangles from normals: Vlachos et al. 2001). The four parts of a triangle of area A,
divided at three edges with the same s, enclose the volume 3/4 s A more. Therefore a vertex moves
inwards by SINK times the mean s of its edges, and with it the middles of these edges. Edges at
walls and bodies, where the mesh has true edges, are not divided. A triangle is divided into one
part more than it has divided edges, so that a closed mesh stays closed.
"""

import math

import taichi as ti

from msph.device_table import DeviceTable, f32, i32
from msph.launches import data_oriented, kernel
from msph.surface.bodies import Bodies
from msph.surface.drops import Drops
from msph.surface.mesh import SurfaceMesh
from msph.surface.room import SurfaceRoom

vec3 = ti.math.vec3

# Cosines of the angles between normals above which edges are divided, 15 degrees, and fully curved,
# 25 degrees. At 15 degrees an edge of 0.75 spacings lies on a curve of radius 2.9 spacings.
FLAT, CURVED = math.cos(math.radians(15.0)), math.cos(math.radians(25.0))
# Largest s over the length of the edge (-): 0.29 for normals at 120 degrees.
MAX_RISE = 0.3
# Least length of the sum of two normals across the edge (-), below which their mean is undefined.
MIN_SUM = 0.2
# Inward motion of vertices over the mean s of their edges (-): 3/4 by theory for small s; with 0.86
# pairs of particles keep their volume within 0.5 %.
SINK = 0.86
# Distance from a wall at which a vertex is on the wall, over the box's longest edge (-).
ON_WALL = 1e-5


@data_oriented
class Rounding:
    """Rounds a mesh after marching cubes and the addition of drops.

    By vertex: first, number: range of the divided edges to vertices of higher index; rise [m],
    edges: sum of s and number of edges of divided triangles. far: the other vertex of each divided
    edge. parts (triangles): bit m is set if the edge from corner m to the next is divided. numbers:
    vertices and triangles of marching cubes; edges found to divide, edges divided (all or, if the
    mesh has no room for all, none) and triangles added; margin [m]: distance from bodies within
    which edges stay.
    """

    def __init__(self, mesh: SurfaceMesh, drops: Drops, bodies: Bodies, room: SurfaceRoom):
        self.mesh, self.drops, self.bodies = mesh, drops, bodies
        self.first, self.number, self.edges, self.far = (
            ti.field(ti.i32, shape=room.vertices) for _ in range(4)
        )
        self.rise = ti.field(ti.f32, shape=room.vertices)
        self.parts = ti.field(ti.i32, shape=room.triangles)
        self.numbers = DeviceTable(
            (), vertices=i32, triangles=i32, found=i32, divided=i32, added=i32, margin=f32
        )

    def load(self, cell: float) -> None:
        """Loads a scene. cell [m]: edge of a cell; mesh edges nearer than this to a body stay."""
        self.numbers.fill(margin=cell)

    def round(self, bodies: bool) -> None:
        """Rounds the mesh; bodies: the scene has bodies."""
        self.mark(bodies)
        self.divide()

    @kernel
    def mark(self, bodies: ti.template()):
        """Finds the edges to divide. bodies: as in round()."""
        ti.loop_config(serialize=True)
        for _ in range(1):
            self.numbers.vertices[None] = self.drops.numbers.first_vertex[None]
            self.numbers.triangles[None] = self.drops.numbers.first_triangle[None]
            self.numbers.found[None] = self.numbers.added[None] = 0
        for v in range(self.drops.numbers.first_vertex[None]):
            self.number[v] = self.edges[v] = 0
            self.rise[v] = 0.0
        for t in range(self.drops.numbers.first_triangle[None]):
            corners, parts = self.mesh.triangles[t], 0
            rises = vec3(0.0)
            # A runtime loop: unrolled, it takes three times as long to compile.
            for m in range(3):
                a, b = corners[m], corners[(m + 1) % 3]
                curved, rises[m] = self.curve(ti.min(a, b), ti.max(a, b), bodies)
                parts |= ti.cast(curved, ti.i32) << m
            self.parts[t] = parts
            if parts != 0:
                # Its two triangles see an edge in opposite directions: once from each end.
                for m in ti.static(range(3)):
                    a, b = corners[m], corners[(m + 1) % 3]
                    self.edges[a] += 1
                    if parts >> m & 1 == 1:
                        self.rise[a] += rises[m]
                        if a < b:
                            self.number[a] += 1

    @ti.func
    def curve(self, a, b, bodies: ti.template()):
        """Returns whether the edge between vertices a < b is divided, and its s [m]."""
        n_a, n_b = self.mesh.normals[a], self.mesh.normals[b]
        cosine, rise = n_a.dot(n_b), 0.0
        curved = cosine < FLAT
        if curved:
            x_a, x_b = self.mesh.vertices[a], self.mesh.vertices[b]
            curved = self.is_free(x_a, bodies) and self.is_free(x_b, bodies)
            way = x_b - x_a
            length = way.norm()
            curved = curved and length > 0.0 and self.across(n_a + n_b, way).norm() > MIN_SUM
            if curved:
                sine = ti.math.clamp(0.5 * (n_b - n_a).dot(way) / length, -1.0, 1.0)
                rise = 0.5 * sine / (1.0 + ti.sqrt(1.0 - sine * sine))
                fade = ti.math.clamp((FLAT - cosine) / (FLAT - CURVED), 0.0, 1.0)
                rise = fade * length * ti.math.clamp(rise, -MAX_RISE, MAX_RISE)
        return curved, rise

    @ti.func
    def across(self, v, way):
        """Returns the part of v across an edge `way`."""
        return v - (v.dot(way) / way.norm_sqr()) * way

    @ti.func
    def is_free(self, x, bodies: ti.template()):
        """Returns True if x [m] is neither on a wall nor near a body."""
        size = self.bodies.numbers.size[None]
        free = ti.min(x, size - x).min() > ON_WALL * size.max()
        if ti.static(bodies):
            free = free and self.bodies.clearance(x) > self.numbers.margin[None]
        return free

    @kernel
    def divide(self):
        """Makes the middles of the marked edges, divides their triangles and moves vertices
        inwards, if the mesh has room."""
        mesh, n = self.mesh, self.numbers
        for v in range(n.vertices[None]):
            if self.number[v] > 0:
                self.first[v] = ti.atomic_add(n.found[None], self.number[v])
                self.number[v] = 0
        ti.loop_config(serialize=True)
        for _ in range(1):
            room = (mesh.max_triangles - mesh.counts[1]) // 2
            room = ti.min(mesh.max_vertices - mesh.counts[0], room)
            n.divided[None] = ti.select(n.found[None] <= room, n.found[None], 0)
            if n.divided[None] == 0:
                n.vertices[None] = n.triangles[None] = 0
        for t in range(n.triangles[None]):
            corners, parts = mesh.triangles[t], self.parts[t]
            for m in ti.static(range(3)):
                a, b = corners[m], corners[(m + 1) % 3]
                if parts >> m & 1 == 1 and a < b:
                    k = self.first[a] + ti.atomic_add(self.number[a], 1)
                    self.far[k] = b
                    self.make_middle(a, b, mesh.counts[0] + k)
        for t in range(n.triangles[None]):
            if self.parts[t] != 0:
                self.divide_triangle(t)
        for v in range(n.vertices[None]):
            if self.rise[v] != 0.0:
                mesh.vertices[v] = self.in_box(mesh.vertices[v] - self.sink(v) * mesh.normals[v])
        ti.loop_config(serialize=True)
        for _ in range(1):
            for c in ti.static((0, 2)):
                mesh.counts[c] += n.divided[None]
                mesh.counts[c + 1] += n.added[None]

    @ti.func
    def sink(self, v):
        """Returns the inward motion of a vertex [m]."""
        return SINK * self.rise[v] / ti.max(self.edges[v], 1)

    @ti.func
    def make_middle(self, a, b, slot):
        """Makes the vertex `slot` in the middle of the edge between vertices a < b."""
        x_a, x_b = self.mesh.vertices[a], self.mesh.vertices[b]
        normals = self.mesh.normals[a] + self.mesh.normals[b]
        n = self.across(normals, x_b - x_a).normalized()
        _, rise = self.curve(a, b, False)  # the edge is known to be away from bodies
        rise -= 0.5 * (self.sink(a) + self.sink(b))
        self.mesh.vertices[slot] = self.in_box(0.5 * (x_a + x_b) + rise * n)
        self.mesh.normals[slot] = n

    @ti.func
    def in_box(self, x):
        """Returns the point of the box nearest to x [m]."""
        return ti.math.clamp(x, 0.0, self.bodies.numbers.size[None])

    @ti.func
    def middle(self, a, b):
        """Returns the vertex in the middle of an edge, -1 if the edge is not divided."""
        low, high, found = ti.min(a, b), ti.max(a, b), -1
        # Without edges to vertices of higher index, `first` is of an earlier mesh.
        for k in range(self.number[low]):
            if self.far[self.first[low] + k] == high:
                found = self.mesh.counts[0] + self.first[low] + k
        return found

    @ti.func
    def divide_triangle(self, t):
        """Replaces triangle t by its parts: one more than it has divided edges."""
        mesh = self.mesh
        c, middles, number = mesh.triangles[t], ti.Vector([-1, -1, -1]), 0
        for m in ti.static(range(3)):
            if self.parts[t] >> m & 1 == 1:
                middles[m] = self.middle(c[m], c[(m + 1) % 3])
            number += ti.cast(middles[m] >= 0, ti.i32)
        if number == 3:
            slot = mesh.counts[1] + ti.atomic_add(self.numbers.added[None], 3)
            for m in ti.static(range(3)):
                mesh.triangles[slot + m] = ti.Vector([c[m], middles[m], middles[(m + 2) % 3]])
            mesh.triangles[t] = middles
        elif number > 0:
            # Turned so that the first edge is divided, and the last one not.
            for _ in range(2):
                if middles[0] < 0 or middles[2] >= 0:
                    c = ti.Vector([c[1], c[2], c[0]])
                    middles = ti.Vector([middles[1], middles[2], middles[0]])
            slot = mesh.counts[1] + ti.atomic_add(self.numbers.added[None], number)
            mesh.triangles[slot] = ti.Vector([c[0], middles[0], c[2]])
            if number == 1:
                mesh.triangles[t] = ti.Vector([middles[0], c[1], c[2]])
            else:
                mesh.triangles[t] = ti.Vector([middles[0], c[1], middles[1]])
                mesh.triangles[slot + 1] = ti.Vector([middles[0], middles[1], c[2]])
