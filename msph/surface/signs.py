"""Bit masks of the nodes inside the water: a word holds 32 nodes of a z-row.

Marching cubes needs only a few operations on words: the crossed edges along x are inside(i, j) xor
inside(i + 1, j); the surface crosses the cells of which some but not all corners are inside; an
edge's vertex is the first of its word plus the number of crossed edges before it. Words of air or
of deep water take about 1 ns per 32 cells.
"""

import taichi as ti

from msph.launches import data_oriented
from msph.surface.device_lattice import WORD, DeviceLattice
from msph.surface.lattice import PAIR, RUN
from msph.surface.room import SurfaceRoom


@data_oriented
class Signs:
    """Words u32; node k of a z-row is bit k % 32 of word k // 32.

    inside, by row: nodes inside the water. read and deep, by pair of rows along x and y: nodes
    whose sign is the sign of their value, and nodes that are inside wherever read is not set.
    """

    def __init__(self, lattice: DeviceLattice, room: SurfaceRoom):
        self.lattice, self.numbers = lattice, lattice.numbers
        # Upper bound: a row has at least as many runs as words.
        self.room = room.nodes // RUN
        self.pair_room = self.room // PAIR**2
        self.inside = ti.field(ti.u32, shape=self.room)
        self.read, self.deep = (ti.field(ti.u32, shape=self.pair_room) for _ in range(2))

    @ti.func
    def word_count(self):
        nodes = self.numbers.nodes[None]
        return nodes[0] * nodes[1] * self.numbers.words[None]

    @ti.func
    def position(self, q):
        """Returns row (i, j) and word w of the q-th word."""
        words, nodes = self.numbers.words[None], self.numbers.nodes[None]
        row, ny = q // words, nodes[1]
        return ti.Vector([row // ny, row % ny, q % words])

    @ti.func
    def valid(self, i, j, w):
        """Returns the nodes of a word that are neither ghosts nor beyond the end of the row."""
        n, walled = self.numbers.nodes[None], self.numbers.walled[None]
        nodes = ones(ti.math.clamp(n[2] - walled - WORD * w, 0, WORD))
        if walled == 1:
            if w == 0:
                nodes &= ~ti.u32(1)
            if i == 0 or j == 0 or i == n[0] - 1 or j == n[1] - 1:
                nodes = ti.u32(0)
        return nodes

    @ti.func
    def next_word(self, i, j, w):
        """Returns the word of the next nodes along z; beyond the end of the row they are
        outside."""
        at = self.lattice.word_index(i, j, w)
        nodes = self.inside[at] >> ti.u32(1)
        if w + 1 < self.numbers.words[None]:
            nodes |= self.inside[at + 1] << ti.u32(WORD - 1)
        return nodes

    @ti.func
    def has_next(self, w):
        """Returns the nodes of a word that have a next node along z."""
        nodes = self.numbers.nodes[None]
        return ones(ti.min(nodes[2] - 1 - WORD * w, WORD))


@ti.func
def ones(n):
    """Returns a word with the lowest n bits set; 0 <= n <= 32."""
    # A shift by 32 is undefined.
    word = (ti.u32(1) << ti.cast(n & (WORD - 1), ti.u32)) - ti.u32(1)
    return ti.select(n >= WORD, ~ti.u32(0), word)


@ti.func
def lowest_bit(word):
    """Returns the position of the lowest set bit of a word that is not 0."""
    return popcount((word - ti.u32(1)) & ~word)


@ti.func
def popcount(word):
    return ti.cast(ti.math.popcnt(word), ti.i32)


@ti.func
def count_below(word, k):
    """Returns the number of bits set below position k."""
    return popcount(word & ones(k))
