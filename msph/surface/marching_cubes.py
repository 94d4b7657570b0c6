"""Marching cubes with shared vertices over the active blocks of a lattice.

Pass 1 makes one vertex per crossed lattice edge and stores its number at the edge's low node;
pass 2 emits the triangles of each cell from the table. A thread handles a z-run of four nodes or
cells, so the counters see one atomic per run.
"""

import numpy as np
import taichi as ti

from msph.constant_fields import constant_fields
from msph.surface import cube_tables
from msph.surface.lattice import BLOCK, RUNS, Blocks, Lattice
from msph.surface.mesh import SurfaceMesh
from msph.taichi_internals import data_oriented, kernel

vec3 = ti.math.vec3

# Vertices keep this part of an edge's length from its ends, so that no triangle loses all area.
END_GAP = 1e-3
# Squared gradient below which a direction cannot be told.
FLAT = 1e-20


@data_oriented
class MarchingCubes:
    """Polygonises value = 0 of node fields, inside where value > 0.

    value (nx, ny, nz) f32 and gradient, same shape, 3-vectors, are padded to whole blocks
    (lattice.padded). Both must hold at the nodes of the active cells, gradient only at the ends
    of crossed edges. The mesh is closed if all border nodes are outside, as ghosts always are.
    """

    def __init__(self, lattice: Lattice, blocks: Blocks, mesh: SurfaceMesh):
        self.lattice, self.blocks, self.mesh = lattice, blocks, mesh
        self.shape = lattice.shape
        self.value = ti.field(ti.f32, shape=lattice.padded)
        self.gradient = ti.Vector.field(3, ti.f32, shape=lattice.padded)
        self.vertex = ti.Vector.field(3, ti.i32, shape=lattice.padded)
        low = cube_tables.CORNERS[cube_tables.EDGES[:, 0]]
        self.triangle_count, self.triangle_edge, self.edge = constant_fields(
            cube_tables.TRIANGLE_COUNTS,
            cube_tables.TRIANGLES,
            np.column_stack([low, cube_tables.EDGE_AXIS]),
        )

    @staticmethod
    def bytes_needed(shape: tuple[int, int, int]) -> int:
        padded = [BLOCK * -(-n // BLOCK) for n in shape]
        return 4 * 7 * padded[0] * padded[1] * padded[2]

    def run(self) -> None:
        """value, gradient -> mesh, over the blocks listed."""
        self.make_vertices()
        self.make_triangles()

    @ti.func
    def crossed(self, node, need, axis: ti.template()):
        """Whether the edge from a node along an axis belongs to an active cell and is crossed."""
        at = self.blocks.inner_axes(node) & ~(1 << axis)
        far = node + ti.Vector.unit(3, axis, ti.i32)
        hit = False
        if far[axis] < self.shape[axis] and need & self.blocks.reach_mask[at] != 0:
            hit = (self.value[node] > 0.0) != (self.value[far] > 0.0)
        return hit

    @ti.func
    def inside_lattice(self, node):
        return node[0] < self.shape[0] and node[1] < self.shape[1] and node[2] < self.shape[2]

    @kernel
    def make_vertices(self):
        """One vertex per crossed edge of the active cells, at the root of linear interpolation."""
        for c in range(4):
            self.mesh.counts[c] = 0
        for q in range(self.blocks.count[0] * RUNS):
            first, need = self.blocks.run(q)
            bits, n = 0, 0
            for k in range(BLOCK):
                node = first + ti.Vector([0, 0, k])
                if self.inside_lattice(node):
                    for axis in ti.static(range(3)):
                        if self.crossed(node, need, axis):
                            bits |= 1 << (3 * k + axis)
                            n += 1
            if n > 0:
                slot = ti.atomic_add(self.mesh.counts[2], n)
                for k in range(BLOCK):
                    node = first + ti.Vector([0, 0, k])
                    for axis in ti.static(range(3)):
                        if bits >> (3 * k + axis) & 1 != 0:
                            self.place_vertex(node, axis, slot)
                            slot += 1
        ti.loop_config(serialize=True)
        for _ in range(1):
            self.mesh.counts[0] = ti.min(self.mesh.counts[2], self.mesh.max_vertices)

    @ti.func
    def place_vertex(self, node, axis: ti.template(), slot):
        """Store vertex `slot` on the edge from a node along an axis; -1 if it does not fit."""
        self.vertex[node][axis] = ti.select(slot < self.mesh.max_vertices, slot, -1)
        if slot < self.mesh.max_vertices:
            far = node + ti.Vector.unit(3, axis, ti.i32)
            f0, f1 = self.value[node], self.value[far]
            t = ti.math.clamp(f0 / (f0 - f1), END_GAP, 1.0 - END_GAP)
            n = -ti.math.mix(self.gradient[node], self.gradient[far], t)
            if self.at_wall(node, far):
                outwards = ti.select(node[axis] == 0, -1.0, 1.0)
                t, n = 0.5, outwards * vec3(ti.Vector.unit(3, axis, ti.f32))
            x = vec3(0.0)
            for a in ti.static(range(3)):
                x[a] = self.lattice.coordinate[a, node[a]]
            x[axis] += t * (self.lattice.coordinate[axis, far[axis]] - x[axis])
            if n.norm_sqr() < FLAT:
                n = ti.select(f0 > f1, 1.0, -1.0) * ti.Vector.unit(3, axis, ti.f32)
            self.mesh.vertices[slot] = x
            self.mesh.normals[slot] = n.normalized()

    @ti.func
    def at_wall(self, node, far):
        """Whether an edge ends at a ghost behind a wall: the mesh then meets it halfway."""
        found = False
        if ti.static(self.lattice.walled):
            # A ghost is the first or last of an axis along which the edge's ends differ.
            for a in ti.static(range(3)):
                ghost = node[a] == 0 or far[a] == self.shape[a] - 1
                found = found or (far[a] > node[a] and ghost)
        return found

    @ti.func
    def cases_of(self, first):
        """Sign bits of the eight corners of the four cells of a run, 8 bits each; 0 outside the
        lattice."""
        cases = 0
        if first[0] + 1 < self.shape[0] and first[1] + 1 < self.shape[1]:
            for column in range(4):
                i, j = first[0] + (column & 1), first[1] + (column >> 1)
                below = 0
                for k in range(BLOCK + 1):
                    inside = 0
                    if first[2] + k < self.shape[2]:
                        inside = ti.cast(self.value[i, j, first[2] + k] > 0.0, ti.i32)
                    # A node is a lower corner of its cell and an upper one of the cell below.
                    if k > 0:
                        cases |= (below | inside << 4) << (column + 8 * (k - 1))
                    below = inside
            # Cells beyond the last nodes are none.
            left = ti.math.clamp(self.shape[2] - 1 - first[2], 0, BLOCK)
            if left < BLOCK:
                cases &= (1 << (8 * left)) - 1
        return cases

    @ti.func
    def triangle(self, cell, case, t):
        """Vertex numbers of the t-th triangle of a cell."""
        v = ti.Vector([0, 0, 0])
        for m in ti.static(range(3)):
            e = self.triangle_edge[case, t, m]
            low = ti.Vector([self.edge[e, 0], self.edge[e, 1], self.edge[e, 2]])
            v[m] = self.vertex[cell + low][self.edge[e, 3]]
        return v

    @kernel
    def make_triangles(self):
        """The table's triangles for every cell of the active blocks; whole triangles only."""
        for q in range(self.blocks.count[0] * RUNS):
            first, need = self.blocks.run(q)
            cases, n = 0, 0
            if need & 1 != 0:
                cases = self.cases_of(first)
                for k in range(BLOCK):
                    n += self.triangle_count[cases >> (8 * k) & 255]
            if n > 0:
                ti.atomic_add(self.mesh.counts[3], n)
                if self.mesh.counts[2] > self.mesh.max_vertices:
                    n = self.count_whole(first, cases)
                slot = ti.atomic_add(self.mesh.counts[1], n)
                for k in range(BLOCK):
                    case = cases >> (8 * k) & 255
                    for t in range(self.triangle_count[case]):
                        v = self.triangle(first + ti.Vector([0, 0, k]), case, t)
                        if v.min() >= 0:
                            if slot < self.mesh.max_triangles:
                                self.mesh.triangles[slot] = v
                            slot += 1
        ti.loop_config(serialize=True)
        for _ in range(1):
            self.mesh.counts[1] = ti.min(self.mesh.counts[1], self.mesh.max_triangles)

    @ti.func
    def count_whole(self, first, cases):
        """Triangles of a run of cells whose vertices all fitted."""
        n = 0
        for k in range(BLOCK):
            case = cases >> (8 * k) & 255
            for t in range(self.triangle_count[case]):
                if self.triangle(first + ti.Vector([0, 0, k]), case, t).min() >= 0:
                    n += 1
        return n
