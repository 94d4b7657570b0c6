"""Which nodes lie in the water, a bit each: 32 nodes of a z-row make a word.

What marching cubes looks for follows from a few operations on words: the edges along x that are
crossed are inside(i, j) xor inside(i + 1, j), the cells that hold surface are those of which some
but not all corners are inside, and an edge's vertex is the first of its word plus the number of
crossed edges before it. So whole rows of air and of deep water pass at a nanosecond for 32 cells.
"""

import taichi as ti

from msph.surface.device_lattice import WORD, DeviceLattice
from msph.surface.lattice import PAIR, RUN
from msph.surface.room import SurfaceRoom
from msph.taichi_internals import data_oriented


@data_oriented
class Signs:
    """Words u32, each bit k % 32 of word k // 32 for node k of a z-row.

    inside, by row: nodes that lie in the water. read, deep, by pair of rows along x and y: nodes
    whose sign is that of their value, and among the others those that lie in the water.
    """

    def __init__(self, lattice: DeviceLattice, room: SurfaceRoom):
        self.lattice, self.numbers = lattice, lattice.numbers
        # A row has at least as many runs as words.
        self.room = room.nodes // RUN
        self.pair_room = self.room // PAIR**2
        self.inside = ti.field(ti.u32, shape=self.room)
        self.read, self.deep = (ti.field(ti.u32, shape=self.pair_room) for _ in range(2))

    @ti.func
    def total(self):
        """Words of all rows."""
        nodes = self.numbers.nodes[None]
        return nodes[0] * nodes[1] * self.numbers.words[None]

    @ti.func
    def place(self, q):
        """Row (i, j) and word w of the q-th word of all."""
        words, nodes = self.numbers.words[None], self.numbers.nodes[None]
        row, ny = q // words, nodes[1]
        return ti.Vector([row // ny, row % ny, q % words])

    @ti.func
    def real(self, i, j, w):
        """The nodes of a word that are none behind a wall and none beyond the row's end."""
        n, walled = self.numbers.nodes[None], self.numbers.walled[None]
        nodes = ones(ti.math.clamp(n[2] - walled - WORD * w, 0, WORD))
        if walled == 1:
            if w == 0:
                nodes &= ~ti.u32(1)
            if i == 0 or j == 0 or i == n[0] - 1 or j == n[1] - 1:
                nodes = ti.u32(0)
        return nodes

    @ti.func
    def above(self, i, j, w):
        """The word of the next nodes along z; what lies beyond the row's end is outside."""
        at = self.lattice.word(i, j, w)
        nodes = self.inside[at] >> ti.u32(1)
        if w + 1 < self.numbers.words[None]:
            nodes |= self.inside[at + 1] << ti.u32(WORD - 1)
        return nodes

    @ti.func
    def followed(self, w):
        """The nodes of a word that have a next one along z."""
        nodes = self.numbers.nodes[None]
        return ones(ti.min(nodes[2] - 1 - WORD * w, WORD))

    @ti.func
    def is_read(self, node):
        """Whether a node's value holds."""
        word = self.read[self.lattice.pair(node[0], node[1], node[2] // WORD)]
        return (word >> ti.cast(node[2] % WORD, ti.u32)) & ti.u32(1) != 0

    @ti.func
    def is_inside(self, node):
        """Whether a node lies in the water."""
        word = self.inside[self.lattice.word(node[0], node[1], node[2] // WORD)]
        return (word >> ti.cast(node[2] % WORD, ti.u32)) & ti.u32(1) != 0


@ti.func
def ones(n):
    """The lowest n bits; 0 <= n <= 32."""
    # A shift by 32 has no defined result.
    word = (ti.u32(1) << ti.cast(n & (WORD - 1), ti.u32)) - ti.u32(1)
    return ti.select(n >= WORD, ~ti.u32(0), word)


@ti.func
def lowest(word):
    """The place of the lowest bit set of a word that is not 0."""
    return count((word - ti.u32(1)) & ~word)


@ti.func
def count(word):
    """Bits set."""
    return ti.cast(ti.math.popcnt(word), ti.i32)


@ti.func
def before(word, k):
    """Bits set below place k."""
    return count(word & ones(k))
