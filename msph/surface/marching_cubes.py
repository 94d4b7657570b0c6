"""Marching cubes with shared vertices over the words of signs of a lattice.

Pass 1 finds the signs; pass 2 makes one vertex per crossed lattice edge, those of a word one after
the other; pass 3 emits the triangles of each cell from the table. A thread handles the edges or
cells of a word, so the counters see one atomic per word that has any.
"""

import numpy as np
import taichi as ti

from msph.device_table import DeviceTable, i32
from msph.surface import cube_tables
from msph.surface.device_lattice import WORD, DeviceLattice
from msph.surface.lattice import Lattice
from msph.surface.mesh import SurfaceMesh
from msph.surface.room import SurfaceRoom
from msph.surface.signs import Signs, before, count, lowest
from msph.taichi_internals import data_oriented, kernel

vec3, vec4 = ti.math.vec3, ti.math.vec4

# Vertices keep this part of an edge's length from its ends, so that no triangle loses all area.
END_GAP = 1e-3
# Squared gradient below which a direction cannot be told.
FLAT = 1e-20
# Cut (-) where no body is near: above all values.
OPEN = 1e9


@data_oriented
class MarchingCubes:
    """Polygonises level = 0 of node fields, inside where level > 0.

    value and cut f32 (nodes): the level is value - iso, but at most cut; where value is not below
    cut, a body's, it stays. gradient, 3-vectors (nodes), is that of the level. They must hold where
    signs.read says so, gradient only at the ends of crossed edges. The mesh is closed if all border
    nodes are outside, as ghosts always are. crossed (words) u32 and first (words) i32, 3-vectors by
    axis: crossed edges of a word, and the first one's vertex. Arrays are flat, their indices those
    of `lattice`.
    """

    def __init__(self, room: SurfaceRoom):
        self.lattice = DeviceLattice(room)
        self.numbers = self.lattice.numbers
        self.signs = Signs(self.lattice, room)
        self.mesh = SurfaceMesh(room.vertices, room.triangles)
        self.value, self.cut = (ti.field(ti.f32, shape=room.nodes) for _ in range(2))
        self.gradient = ti.Vector.field(3, ti.f32, shape=room.nodes)
        self.iso = ti.field(ti.f32, shape=())
        self.crossed = ti.Vector.field(3, ti.u32, shape=self.signs.room)
        self.first = ti.Vector.field(3, ti.i32, shape=self.signs.room)
        # By case: the edges of its triangles, three for each, and in every column how many it has.
        # Numbers and no vectors: one read by a component that varies may be any place in memory to
        # Taichi, which then adds up no sums by thread.
        codes = cube_tables.EDGES[:, 0] + 8 * cube_tables.EDGE_AXIS
        edges = codes[cube_tables.TRIANGLES].reshape(256, -1)
        counts = np.repeat(cube_tables.TRIANGLE_COUNTS, edges.shape[1])
        # Of an edge: corner of its low end, and 8 times its axis.
        self.cases = DeviceTable(edges.shape, edge=i32, count=i32)
        self.cases.fill(edge=edges[..., None], count=counts.reshape(*edges.shape, 1))

    def load_field(self, lattice: Lattice, value: np.ndarray, gradient: np.ndarray) -> None:
        """A field of which all values hold, in place of water: value (nx, ny, nz), gradient
        (nx, ny, nz, 3)."""
        self.lattice.load(lattice)
        # Values beyond the lattice must not be read: they say "inside".
        beyond = [(0, p - n) for p, n in zip(lattice.padded, lattice.shape, strict=True)]
        padded = np.pad(value, beyond, constant_values=1.0).astype(np.float32)
        slopes = np.pad(gradient, [*beyond, (0, 0)]).astype(np.float32)
        self._write(padded.ravel(), slopes.reshape(-1, 3))

    @kernel
    def _write(
        self,
        value: ti.types.ndarray(dtype=ti.f32, ndim=1),
        gradient: ti.types.ndarray(dtype=ti.f32, ndim=2),
    ):
        for q in range(value.shape[0]):
            self.value[q], self.cut[q] = value[q], OPEN
            self.gradient[q] = vec3(gradient[q, 0], gradient[q, 1], gradient[q, 2])
        for q in range(self.signs.pair_room):
            self.signs.read[q], self.signs.deep[q] = ~ti.u32(0), ti.u32(0)

    def run(self) -> None:
        """value, gradient -> mesh."""
        self.find_signs()
        self.make_vertices()
        self.make_triangles()

    @kernel
    def find_signs(self):
        """inside, from the values where they are read."""
        for q in range(self.signs.total()):
            self.find_word(q)

    @ti.func
    def find_word(self, q):
        """Signs of the nodes of a word."""
        i, j, w = self.signs.place(q)
        pair = self.lattice.pair(i, j, w)
        read, found = self.signs.read[pair], ti.u32(0)
        if read != 0:
            iso, first = self.iso[None], self.lattice.at(ti.Vector([i, j, WORD * w]))
            nodes = self.numbers.nodes[None]
            for m in range(ti.min(WORD, nodes[2] - WORD * w)):
                level = self.below_cut(self.value[first + m], self.cut[first + m], iso)
                found |= ti.cast(level > 0.0, ti.u32) << ti.cast(m, ti.u32)
        inside = (found & read) | (self.signs.deep[pair] & ~read)
        self.signs.inside[q] = inside & self.signs.real(i, j, w)

    @ti.func
    def below_cut(self, f, cut, iso):
        """The level by its parts."""
        return ti.select(f < cut, ti.min(f - iso, cut), f)

    @ti.func
    def level(self, node):
        """The field whose zero is the surface; 1 or -1 where no value is known."""
        at = self.lattice.at(node)
        f = self.below_cut(self.value[at], self.cut[at], self.iso[None])
        if not self.signs.is_read(node):
            f = ti.select(self.signs.is_inside(node), 1.0, -1.0)
        return f

    @kernel
    def make_vertices(self):
        """One vertex per crossed edge, at the root of linear interpolation."""
        for c in range(4):
            self.mesh.counts[c] = 0
        for q in range(self.signs.total()):
            i, j, w = self.signs.place(q)
            own, nodes = self.signs.inside[q], self.numbers.nodes[None]
            # The last row is its own neighbour: no edge leaves the lattice.
            bits = ti.Vector(
                [
                    own ^ self.signs.inside[self.lattice.word(ti.min(i + 1, nodes[0] - 1), j, w)],
                    own ^ self.signs.inside[self.lattice.word(i, ti.min(j + 1, nodes[1] - 1), w)],
                    (own ^ self.signs.above(i, j, w)) & self.signs.followed(w),
                ],
                dt=ti.u32,
            )
            if (bits[0] | bits[1] | bits[2]) != 0:
                nx, ny = count(bits[0]), count(bits[1])
                n = nx + ny + count(bits[2])
                slot = ti.atomic_add(self.mesh.counts[2], n)
                self.crossed[q] = bits
                self.first[q] = ti.Vector([slot, slot + nx, slot + nx + ny])
                for axis in range(3):
                    rest = bits[axis]
                    while rest != 0:
                        node = ti.Vector([i, j, WORD * w + lowest(rest)])
                        rest &= rest - ti.u32(1)
                        if slot < self.mesh.max_vertices:
                            self.place_vertex(node, axis, slot)
                        slot += 1
        ti.loop_config(serialize=True)
        for _ in range(1):
            self.mesh.counts[0] = ti.min(self.mesh.counts[2], self.mesh.max_vertices)

    @ti.func
    def place_vertex(self, node, axis, slot):
        """Vertex `slot` on the edge from a node along an axis."""
        step = ti.cast(ti.Vector([axis == 0, axis == 1, axis == 2]), ti.i32)
        far, unit = node + step, ti.cast(step, ti.f32)
        f0, f1 = self.level(node), self.level(far)
        t = ti.math.clamp(f0 / (f0 - f1), END_GAP, 1.0 - END_GAP)
        n = -ti.math.mix(
            self.gradient[self.lattice.at(node)], self.gradient[self.lattice.at(far)], t
        )
        if self.at_wall(node, far):
            t, n = 0.5, ti.select(node.dot(step) == 0, -1.0, 1.0) * unit
        x = self.lattice.point(node)
        x += t * (self.lattice.point(far) - x)
        if n.norm_sqr() < FLAT:
            n = ti.select(f0 > f1, 1.0, -1.0) * unit
        self.mesh.vertices[slot] = x
        self.mesh.normals[slot] = n.normalized()

    @ti.func
    def at_wall(self, node, far):
        """Whether an edge ends at a ghost behind a wall: the mesh then meets it halfway."""
        found, nodes = False, self.numbers.nodes[None]
        if self.numbers.walled[None] == 1:
            # A ghost is the first or last of an axis along which the edge's ends differ.
            for a in ti.static(range(3)):
                ghost = node[a] == 0 or far[a] == nodes[a] - 1
                found = found or (far[a] > node[a] and ghost)
        return found

    @ti.func
    def cell_words(self):
        """Words of cells."""
        nodes = self.numbers.nodes[None]
        return (nodes[0] - 1) * (nodes[1] - 1) * self.numbers.words[None]

    @ti.func
    def cell_place(self, q):
        """Row (i, j) and word w of the q-th word of cells."""
        words, nodes = self.numbers.words[None], self.numbers.nodes[None]
        row, rows = q // words, nodes[1] - 1
        return ti.Vector([row // rows, row % rows, q % words])

    @ti.func
    def corners(self, i, j, w):
        """Words of signs of the four lower and the four upper corners of a word's cells."""
        low, high = ti.Vector([ti.u32(0)] * 4), ti.Vector([ti.u32(0)] * 4)
        for c in ti.static(range(4)):
            low[c] = self.signs.inside[self.lattice.word(i + (c & 1), j + (c >> 1), w)]
            high[c] = self.signs.above(i + (c & 1), j + (c >> 1), w)
        return low, high

    @ti.func
    def cells(self, low, high, w):
        """The cells of a word that the surface crosses."""
        some = low[0] | low[1] | low[2] | low[3] | high[0] | high[1] | high[2] | high[3]
        every = low[0] & low[1] & low[2] & low[3] & high[0] & high[1] & high[2] & high[3]
        return some & ~every & self.signs.followed(w)

    @ti.func
    def case(self, low, high, k):
        """Sign bits of the eight corners of the k-th cell of a word."""
        found = ti.u32(0)
        for c in ti.static(range(4)):
            found |= ((low[c] >> ti.cast(k, ti.u32)) & ti.u32(1)) << ti.u32(c)
            found |= ((high[c] >> ti.cast(k, ti.u32)) & ti.u32(1)) << ti.u32(c + 4)
        return ti.cast(found, ti.i32)

    @ti.func
    def edge(self, cell, code):
        """Low node and axis of an edge of a cell."""
        return cell + ti.Vector([code & 1, code >> 1 & 1, code >> 2 & 1]), code >> 3

    @ti.func
    def triangle(self, cell, case, t):
        """Vertex numbers of the t-th triangle of a cell."""
        v = ti.Vector([0, 0, 0])
        for m in ti.static(range(3)):
            low, axis = self.edge(cell, self.cases.edge[case, 3 * t + m])
            at = self.lattice.word(low[0], low[1], low[2] // WORD)
            v[m] = self.first[at][axis] + before(self.crossed[at][axis], low[2] % WORD)
        return v

    @kernel
    def make_triangles(self):
        """The table's triangles for every cell; whole triangles only."""
        for q in range(self.cell_words()):
            i, j, w = self.cell_place(q)
            low, high = self.corners(i, j, w)
            cells = self.cells(low, high, w)
            if cells != 0:
                n, whole, rest = 0, 0, cells
                while rest != 0:
                    n += self.cases.count[self.case(low, high, lowest(rest)), 0]
                    rest &= rest - ti.u32(1)
                ti.atomic_add(self.mesh.counts[3], n)
                whole = n
                if self.mesh.counts[2] > self.mesh.max_vertices:
                    whole = self.count_whole(i, j, w, low, high, cells)
                slot = ti.atomic_add(self.mesh.counts[1], whole)
                rest = cells
                while rest != 0:
                    k = lowest(rest)
                    rest &= rest - ti.u32(1)
                    case = self.case(low, high, k)
                    for t in range(self.cases.count[case, 0]):
                        v = self.triangle(ti.Vector([i, j, WORD * w + k]), case, t)
                        if v.max() < self.mesh.max_vertices:
                            if slot < self.mesh.max_triangles:
                                self.mesh.triangles[slot] = v
                            slot += 1
        ti.loop_config(serialize=True)
        for _ in range(1):
            self.mesh.counts[1] = ti.min(self.mesh.counts[1], self.mesh.max_triangles)

    @ti.func
    def count_whole(self, i, j, w, low, high, cells):
        """Triangles of a word of cells whose vertices all fitted."""
        n, rest = 0, cells
        while rest != 0:
            k = lowest(rest)
            rest &= rest - ti.u32(1)
            case = self.case(low, high, k)
            for t in range(self.cases.count[case, 0]):
                v = self.triangle(ti.Vector([i, j, WORD * w + k]), case, t)
                n += ti.cast(v.max() < self.mesh.max_vertices, ti.i32)
        return n
