"""Marching cubes with shared vertices on words of signs.

Pass 1 computes the signs; pass 2 makes one vertex per crossed lattice edge, consecutive within a
word; pass 3 emits the triangles of each cell from the table. A thread handles the edges or cells of
one word, so each counter receives one atomic addition per word that is not empty.
"""

import numpy as np
import taichi as ti

from msph.device_table import DeviceTable, i32
from msph.launches import data_oriented, heavy_kernel, kernel
from msph.surface import cube_tables
from msph.surface.device_lattice import WORD, DeviceLattice
from msph.surface.lattice import Lattice
from msph.surface.mesh import SurfaceMesh
from msph.surface.room import SurfaceRoom
from msph.surface.signs import Signs, count_below, lowest_bit, popcount

vec3, vec4 = ti.math.vec3, ti.math.vec4

# Smallest distance of a vertex from the ends of its edge, over the edge's length: no triangle
# loses all area.
END_GAP = 1e-3
# Newton steps to the zero on an edge, and least slope there over the mean slope (-).
ROOT_STEPS, MIN_SLOPE = 2, 0.1
# Squared gradient below which its direction is undefined.
MIN_GRADIENT2 = 1e-20
# Cut (-) where no body is near: larger than all values.
NO_CUT = 1e9


@data_oriented
class MarchingCubes:
    """Polygonises level = 0 of node fields; the inside is level > 0.

    value and cut f32 (nodes): level = min(value - iso, cut + overlap), the cut by bodies. gradient
    and cut_gradient, 3-vectors (nodes): their gradients. value and cut must be valid where
    signs.read is set, the gradients at the ends of crossed edges. The mesh is closed if all border
    nodes are outside, as ghosts are. crossed (words) u32 and first (words) i32, 3-vectors by axis:
    crossed edges of a word and the vertex of the first one. Arrays are flat, with the indices of
    `lattice`. way, 3-vectors (vertices): dx/dvalue of a vertex at x [m], 0 on walls and bodies.
    volume, slope [m^3]: enclosed by the mesh, and its derivative by value.
    """

    def __init__(self, room: SurfaceRoom):
        self.lattice = DeviceLattice(room)
        self.numbers = self.lattice.numbers
        self.signs = Signs(self.lattice, room)
        self.mesh = SurfaceMesh(room.vertices, room.triangles)
        self.value, self.cut = (ti.field(ti.f32, shape=room.nodes) for _ in range(2))
        self.gradient = ti.Vector.field(3, ti.f32, shape=room.nodes)
        self.cut_gradient = ti.Vector.field(3, ti.f32, shape=room.nodes)
        self.iso, self.overlap = ti.field(ti.f32, shape=()), ti.field(ti.f32, shape=())
        self.crossed = ti.Vector.field(3, ti.u32, shape=self.signs.room)
        self.first = ti.Vector.field(3, ti.i32, shape=self.signs.room)
        self.way = ti.Vector.field(3, ti.f32, shape=room.vertices)
        self.volume, self.slope = ti.field(ti.f32, shape=()), ti.field(ti.f32, shape=())
        self.words = ti.field(ti.i32, shape=())
        # By case: the edges of its triangles, three per triangle, and in every column the number
        # of triangles. Scalars, since a vector read at a varying component stops Taichi from
        # summing by thread.
        codes = cube_tables.EDGES[:, 0] + 8 * cube_tables.EDGE_AXIS
        edges = codes[cube_tables.TRIANGLES].reshape(256, -1)
        counts = np.repeat(cube_tables.TRIANGLE_COUNTS, edges.shape[1])
        # Code of an edge: corner of its low end, plus 8 times its axis.
        self.cases = DeviceTable(edges.shape, edge=i32, count=i32)
        self.cases.fill(edge=edges[..., None], count=counts.reshape(*edges.shape, 1))

    def load_field(self, lattice: Lattice, value: np.ndarray, gradient: np.ndarray) -> None:
        """Loads a field valid at all nodes: value (nx, ny, nz) and gradient (nx, ny, nz, 3)."""
        self.lattice.load(lattice)
        # Padding nodes are "inside", so that tests fail if padding is read.
        beyond = [(0, p - n) for p, n in zip(lattice.padded, lattice.shape, strict=True)]
        values = np.pad(value, beyond, constant_values=1.0).astype(np.float32).ravel()
        slopes = np.pad(gradient, [*beyond, (0, 0)]).astype(np.float32).reshape(-1, 3)
        unused = (0, self.value.shape[0] - len(values))
        self.value.from_numpy(np.pad(values, unused))
        self.gradient.from_numpy(np.pad(slopes, (unused, (0, 0))))
        self.cut.fill(NO_CUT)
        self.signs.read.from_numpy(np.full(self.signs.pair_room, ~np.uint32(0)))
        self.signs.deep.fill(0)

    def run(self) -> None:
        """Makes the mesh from value and gradient."""
        self.make_vertices()
        self.make_triangles()

    @kernel
    def make_vertices(self):
        """Makes all vertices."""
        self.words[None] = self.signs.word_count()
        self.place_vertices()

    @ti.func
    def place_vertices(self):
        """Makes the vertices of the first words[None] words: of all, or of none. Call it at the top
        level of a kernel, where its loops run in parallel. One kernel for vertices and triangles is
        invalid SPIR-V (taichi issue #8741)."""
        self.find_signs()
        self.find_vertices()

    @ti.func
    def find_signs(self):
        """Computes the signs of the nodes."""
        for q in range(self.words[None]):
            i, j, w = self.signs.position(q)
            pair = self.lattice.pair_index(i, j, w)
            read, found = self.signs.read[pair], ti.u32(0)
            if read != 0:
                first = self.lattice.node_index(ti.Vector([i, j, WORD * w]))
                nodes = self.numbers.nodes[None]
                for m in range(ti.min(WORD, nodes[2] - WORD * w)):
                    level = self.level_at(first + m)
                    found |= ti.cast(level > 0.0, ti.u32) << ti.cast(m, ti.u32)
            inside = (found & read) | (self.signs.deep[pair] & ~read)
            self.signs.inside[q] = inside & self.signs.valid(i, j, w)

    @ti.func
    def level_at(self, at):
        """Returns the level at a node, by its index in the fields."""
        return ti.min(self.value[at] - self.iso[None], self.cut[at] + self.overlap[None])

    @ti.func
    def is_cut(self, at):
        """Returns True if a body determines the level at a node [flat index]."""
        return self.value[at] - self.iso[None] >= self.cut[at] + self.overlap[None]

    @ti.func
    def gradient_at(self, at):
        """Returns the gradient of the level at a node [flat index]."""
        return ti.select(self.is_cut(at), self.cut_gradient[at], self.gradient[at])

    @ti.func
    def level(self, node):
        """Returns the level at a node; 1 or -1 where value is not valid."""
        at = self.lattice.node_index(node)
        f = self.level_at(at)
        i, j, w, bit = node[0], node[1], node[2] // WORD, ti.cast(node[2] % WORD, ti.u32)
        if (self.signs.read[self.lattice.pair_index(i, j, w)] >> bit) & ti.u32(1) == 0:
            inside = self.signs.inside[self.lattice.word_index(i, j, w)] >> bit
            f = ti.select(inside & ti.u32(1) != 0, 1.0, -1.0)
        return f

    @ti.func
    def find_vertices(self):
        """Makes one vertex per crossed edge, at the zero of the level (root())."""
        for c in range(4):
            self.mesh.counts[c] = 0
        for q in range(self.words[None]):
            i, j, w = self.signs.position(q)
            own, nodes = self.signs.inside[q], self.numbers.nodes[None]
            # The last row is its own neighbour, so no edge leaves the lattice.
            next_x = self.lattice.word_index(ti.min(i + 1, nodes[0] - 1), j, w)
            next_y = self.lattice.word_index(i, ti.min(j + 1, nodes[1] - 1), w)
            along_z = (own ^ self.signs.next_word(i, j, w)) & self.signs.has_next(w)
            bits = ti.Vector(
                [own ^ self.signs.inside[next_x], own ^ self.signs.inside[next_y], along_z],
                dt=ti.u32,
            )
            if (bits[0] | bits[1] | bits[2]) != 0:
                nx, ny = popcount(bits[0]), popcount(bits[1])
                n = nx + ny + popcount(bits[2])
                slot = ti.atomic_add(self.mesh.counts[2], n)
                self.crossed[q] = bits
                self.first[q] = ti.Vector([slot, slot + nx, slot + nx + ny])
                for axis in range(3):
                    rest = bits[axis]
                    while rest != 0:
                        node = ti.Vector([i, j, WORD * w + lowest_bit(rest)])
                        rest &= rest - ti.u32(1)
                        if slot < self.mesh.max_vertices:
                            self.place_vertex(node, axis, slot)
                        slot += 1
        ti.loop_config(serialize=True)
        for _ in range(1):
            self.mesh.counts[0] = ti.min(self.mesh.counts[2], self.mesh.max_vertices)

    @ti.func
    def place_vertex(self, node, axis, slot):
        """Writes vertex `slot` on the edge from a node along an axis."""
        step = ti.cast(ti.Vector([axis == 0, axis == 1, axis == 2]), ti.i32)
        far, unit = node + step, ti.cast(step, ti.f32)
        a, b = self.lattice.node_index(node), self.lattice.node_index(far)
        x = self.lattice.point(node)
        along = self.lattice.point(far) - x
        f0, f1 = self.level(node), self.level(far)
        t, slope = self.root(f0, f1, a, b, along)
        t = ti.math.clamp(t, END_GAP, 1.0 - END_GAP)
        n = -ti.math.mix(self.gradient_at(a), self.gradient_at(b), t)
        n -= (slope / along.norm_sqr() + n.dot(along) / along.norm_sqr()) * along
        way = -1.0 / slope
        if self.at_wall(node, far):
            t, n, way = 0.5, ti.select(node.dot(step) == 0, -1.0, 1.0) * unit, 0.0
        if self.is_cut(a) or self.is_cut(b):
            way = 0.0
        x += t * along
        if n.norm_sqr() < MIN_GRADIENT2:
            n = ti.select(f0 > f1, 1.0, -1.0) * unit
        self.mesh.vertices[slot] = x
        self.mesh.normals[slot] = n.normalized()
        self.way[slot] = way * along

    @ti.func
    def root(self, f0, f1, a, b, along):
        """Returns t in [0, 1], the zero of the level on an edge from node a to node b [flat
        indices], and the derivative of the level by t there.

        The level is the cubic of Hermite through the levels f0 and f1 of the ends and their slopes:
        on a drop of one particle, a line would be off by a sixth of its radius.
        """
        m0, m1 = self.gradient[a].dot(along), self.gradient[b].dot(along)
        rise = f1 - f0
        if self.is_cut(a) or self.is_cut(b):
            # The level has a kink, or is linear.
            m0, m1 = rise, rise
        low, high, t, slope = 0.0, 1.0, -f0 / rise, rise
        for _ in range(ROOT_STEPS):
            # p(t) = f0 + t (m0 + t (c2 + t c3))
            c2, c3 = 3.0 * rise - 2.0 * m0 - m1, m0 + m1 - 2.0 * rise
            p = f0 + t * (m0 + t * (c2 + t * c3))
            slope = m0 + t * (2.0 * c2 + 3.0 * t * c3)
            if (p > 0.0) == (f0 > 0.0):
                low = t
            else:
                high = t
            t -= p / ti.select(slope * rise > 0.0, slope, rise)
            if t < low or t > high:
                t = 0.5 * (low + high)
        if not slope * rise > MIN_SLOPE * rise * rise:
            slope = MIN_SLOPE * rise
        return t, slope

    @ti.func
    def at_wall(self, node, far):
        """Returns True if an edge ends at a ghost: its vertex is then on the wall, halfway."""
        # A ghost is the first or last node of the axis along which the edge's ends differ.
        ghost = (node == 0) | (far == self.numbers.nodes[None] - 1)
        return self.numbers.walled[None] == 1 and ((far > node) & ghost).any()

    @ti.func
    def cell_position(self, q):
        """Returns row (i, j) and word w of the q-th word of cells."""
        words, nodes = self.numbers.words[None], self.numbers.nodes[None]
        row, rows = q // words, nodes[1] - 1
        return ti.Vector([row // rows, row % rows, q % words])

    @ti.func
    def corners(self, i, j, w):
        """Returns the words of signs at the four lower and the four upper corners of cells."""
        low, high = ti.Vector([ti.u32(0)] * 4), ti.Vector([ti.u32(0)] * 4)
        for c in ti.static(range(4)):
            low[c] = self.signs.inside[self.lattice.word_index(i + (c & 1), j + (c >> 1), w)]
            high[c] = self.signs.next_word(i + (c & 1), j + (c >> 1), w)
        return low, high

    @ti.func
    def cells(self, low, high, w):
        """Returns the cells of a word that the surface crosses."""
        some = low[0] | low[1] | low[2] | low[3] | high[0] | high[1] | high[2] | high[3]
        every = low[0] & low[1] & low[2] & low[3] & high[0] & high[1] & high[2] & high[3]
        return some & ~every & self.signs.has_next(w)

    @ti.func
    def case(self, low, high, k):
        """Returns the sign bits of the eight corners of the k-th cell of a word."""
        found = ti.u32(0)
        for c in range(4):
            found |= ((low[c] >> ti.cast(k, ti.u32)) & ti.u32(1)) << ti.u32(c)
            found |= ((high[c] >> ti.cast(k, ti.u32)) & ti.u32(1)) << ti.u32(c + 4)
        return ti.cast(found, ti.i32)

    @ti.func
    def edge(self, cell, code):
        """Returns low node and axis of an edge of a cell."""
        return cell + ti.Vector([code & 1, code >> 1 & 1, code >> 2 & 1]), code >> 3

    @ti.func
    def triangle(self, cell, case, t):
        """Returns the vertex numbers of the t-th triangle of a cell."""
        v = ti.Vector([0, 0, 0])
        for m in ti.static(range(3)):
            low, axis = self.edge(cell, self.cases.edge[case, 3 * t + m])
            at = self.lattice.word_index(low[0], low[1], low[2] // WORD)
            v[m] = self.first[at][axis] + count_below(self.crossed[at][axis], low[2] % WORD)
        return v

    @heavy_kernel
    def make_triangles(self):
        """Emits the table's triangles of every cell, without triangles that lack a vertex, and
        computes volume and slope."""
        self.volume[None], self.slope[None] = 0.0, 0.0
        for q in range(self.cell_words()):
            i, j, w = self.cell_position(q)
            low, high = self.corners(i, j, w)
            cells = self.cells(low, high, w)
            if cells != 0:
                n, whole, rest = 0, 0, cells
                while rest != 0:
                    n += self.cases.count[self.case(low, high, lowest_bit(rest)), 0]
                    rest &= rest - ti.u32(1)
                ti.atomic_add(self.mesh.counts[3], n)
                whole = n
                if self.mesh.counts[2] > self.mesh.max_vertices:
                    whole = self.count_kept(i, j, w, low, high, cells)
                slot = ti.atomic_add(self.mesh.counts[1], whole)
                rest, part = cells, ti.math.vec2(0.0)
                while rest != 0:
                    k = lowest_bit(rest)
                    rest &= rest - ti.u32(1)
                    case = self.case(low, high, k)
                    for t in range(self.cases.count[case, 0]):
                        v = self.triangle(ti.Vector([i, j, WORD * w + k]), case, t)
                        if v.max() < self.mesh.max_vertices:
                            if slot < self.mesh.max_triangles:
                                self.mesh.triangles[slot] = v
                            slot += 1
                            part += self.volume_of(v)
                self.volume[None] += part[0]
                self.slope[None] += part[1]
        ti.loop_config(serialize=True)
        for _ in range(1):
            self.mesh.counts[1] = ti.min(self.mesh.counts[1], self.mesh.max_triangles)

    @ti.func
    def cell_words(self):
        """Returns the number of words of cells, at most words[None]."""
        nodes = self.numbers.nodes[None] - 1
        return ti.min(self.words[None], nodes[0] * nodes[1] * self.numbers.words[None])

    @ti.func
    def volume_of(self, v):
        """Returns the parts of the triangle of vertices v in volume and slope [m^3]:
        a . (b x c)/6 and (b - a) x (c - a)/2 . (dx_a + dx_b + dx_c)/3."""
        a, b, c = self.mesh.vertices[v[0]], self.mesh.vertices[v[1]], self.mesh.vertices[v[2]]
        way = self.way[v[0]] + self.way[v[1]] + self.way[v[2]]
        return ti.math.vec2(a.dot(b.cross(c)), (b - a).cross(c - a).dot(way)) / 6.0

    @ti.func
    def count_kept(self, i, j, w, low, high, cells):
        """Returns the number of triangles of a word of cells of which all vertices fit."""
        n, rest = 0, cells
        while rest != 0:
            k = lowest_bit(rest)
            rest &= rest - ti.u32(1)
            case = self.case(low, high, k)
            for t in range(self.cases.count[case, 0]):
                v = self.triangle(ti.Vector([i, j, WORD * w + k]), case, t)
                n += ti.cast(v.max() < self.mesh.max_vertices, ti.i32)
        return n
