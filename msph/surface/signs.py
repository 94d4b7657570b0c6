"""Which nodes lie in the water, a bit each: 32 nodes of a z-row make a word.

What marching cubes looks for follows from a few operations on words: the edges along x that are
crossed are inside(i, j) xor inside(i + 1, j), the cells that hold surface are those of which some
but not all corners are inside, and an edge's vertex is the first of its word plus the number of
crossed edges before it. So whole rows of air and of deep water pass at a nanosecond for 32 cells.
"""

import math

import taichi as ti

from msph.surface.lattice import PAIR, Lattice
from msph.taichi_internals import data_oriented

WORD = 32


def words_of(nodes: int) -> int:
    """Words for a row of so many nodes."""
    return -(-nodes // WORD)


@data_oriented
class Signs:
    """inside (nx, ny, words) u32: bit k % 32 of word k // 32 is set where node k lies in the water.

    read, deep (nx/2, ny/2, words) u32, for pairs of rows along x and y: nodes whose sign is that of
    their value, and among the others those that lie in the water.
    """

    def __init__(self, lattice: Lattice):
        self.lattice, self.shape = lattice, lattice.shape
        nx, ny, nz = self.shape
        self.words = words_of(nz)
        self.total = nx * ny * self.words
        self.inside = ti.field(ti.u32, shape=(nx, ny, self.words))
        pairs = (-(-nx // PAIR), -(-ny // PAIR), self.words)
        self.read, self.deep = (ti.field(ti.u32, shape=pairs) for _ in range(2))

    @staticmethod
    def bytes_needed(shape: tuple[int, int, int]) -> int:
        nx, ny, nz = shape
        pairs = math.ceil(nx / PAIR) * math.ceil(ny / PAIR)
        return 4 * (nx * ny + 2 * pairs) * words_of(nz)

    def read_all(self) -> None:
        """Each node has the sign of its value."""
        self.read.fill(-1)  # all bits
        self.deep.fill(0)

    @ti.func
    def place(self, q):
        """Row (i, j) and word w of the q-th word of all."""
        row = q // self.words
        return ti.Vector([row // self.shape[1], row % self.shape[1], q % self.words])

    @ti.func
    def real(self, i, j, w):
        """The nodes of a word that are none behind a wall and none beyond the row's end."""
        nodes = ones(ti.min(self.shape[2] - WORD * w, WORD))
        if ti.static(self.lattice.walled):
            nodes = ones(ti.math.clamp(self.shape[2] - 1 - WORD * w, 0, WORD))
            if w == 0:
                nodes &= ~ti.u32(1)
            if i == 0 or j == 0 or i == self.shape[0] - 1 or j == self.shape[1] - 1:
                nodes = ti.u32(0)
        return nodes

    @ti.func
    def above(self, i, j, w):
        """The word of the next nodes along z; what lies beyond the row's end is outside."""
        nodes = self.inside[i, j, w] >> ti.u32(1)
        if w + 1 < self.words:
            nodes |= self.inside[i, j, w + 1] << ti.u32(WORD - 1)
        return nodes

    @ti.func
    def followed(self, w):
        """The nodes of a word that have a next one along z."""
        return ones(ti.min(self.shape[2] - 1 - WORD * w, WORD))

    @ti.func
    def is_read(self, i, j, k):
        """Whether a node's value holds."""
        word = self.read[i // PAIR, j // PAIR, k // WORD]
        return (word >> ti.cast(k % WORD, ti.u32)) & ti.u32(1) != 0

    @ti.func
    def is_inside(self, i, j, k):
        """Whether a node lies in the water."""
        return (self.inside[i, j, k // WORD] >> ti.cast(k % WORD, ti.u32)) & ti.u32(1) != 0


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
