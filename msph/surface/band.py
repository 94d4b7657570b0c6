"""Classification of the box into air, band (cells that the surface can cross) and deep water.

Reads the particles; the coverage is evaluated later, at the nodes of the band only. Terms: a tile
is 2 x 2 x 4 nodes that are evaluated together (sums.py), a run the 4 nodes of a tile along z, a
word 32 nodes of a row along z, one bit each (signs.py).

Coverage is sampled at every second lattice node. A sub-block, the 2^3 cells between eight samples,
is skipped if the following bound excludes the surface.

A particle at p adds w(x - p) to the coverage at a point x of a sub-block of diagonal D. The
trilinear interpolation of w from the eight corners is at least rho w(x) - RIM_LOSS w(0), with rho =
(1 - D^2/(4 r^2))^3, poly6 of reach r at D/2 (worst case: a particle at the centre); RIM_LOSS is due
to corners out of reach. Summed over particles, some corner has at least rho c(x). If all corners
have less than rho iso, no node inside reaches iso: air. The same bound on 1 - c, also a sum of
kernels, gives: if all corners have more than 1 - rho (1 - iso), no node inside falls below iso:
deep. The latter assumes that water is not denser than at rest. Both include the shift of iso by the
volume control (water_volume.py).

The bounds hold for kernels of full reach. Sub-blocks within reach of kernels that exceed these
(thin_water.py) are always band, and so are sub-blocks that the surface of a body crosses, unless
they are air.
"""

import numpy as np
import taichi as ti

from msph.launches import data_oriented, heavy_kernel, kernel
from msph.surface.device_lattice import WORD
from msph.surface.fluid_fraction import ISO
from msph.surface.lattice import PAIR, RUN
from msph.surface.room import SurfaceRoom
from msph.surface.signs import Signs, lowest_bit, popcount
from msph.surface.sums import HALF_TILE, TILE, KernelSums
from msph.surface.water_volume import MAX_SHIFT, MIN_SHIFT, MIN_SHIFT_AT_BODIES

AIR, BAND, DEEP = 0, 1, 2
STRIDE = PAIR  # lattice intervals per sample
BLOCKS_PER_WORD = WORD // STRIDE  # sub-blocks along z per word of signs
# Shifts and masks that move the lowest 16 bits of a word to every second bit.
SPREAD_STEPS = ((8, 0x00FF00FF), (4, 0x0F0F0F0F), (2, 0x33333333), (1, 0x55555555))
# Largest loss of the interpolation at the rim of a kernel, over its peak (-): sampled in tests.
RIM_LOSS = 0.016
# Share of the bounds that is used (-): the rest allows for RIM_LOSS and density variations in deep
# water.
MARGIN = 0.9


def corner_bound(spacing: tuple[float, float, float], reach: float) -> float:
    """Returns rho of the module docstring (-), 0 if the cells are too coarse for a bound."""
    diagonal2 = sum((STRIDE * s) ** 2 for s in spacing)
    return max(0.0, 1.0 - diagonal2 / (4.0 * reach * reach)) ** 3


def band_numbers(
    spacing: tuple[float, float, float], finest: float, bodies: bool, thinnest: float
) -> dict:
    """Returns the numbers of the scene that a Band reads, for nodes `spacing` [m] apart, kernels of
    reach `finest` [m] or more, and bodies of depth `thinnest` [m] or more. Raises ValueError if the
    cells are too coarse.

    overlap: marching cubes bevels the end of the mesh, within a cell; an overlap of a cell's
    diagonal keeps the bevel inside bodies. The mesh ends half a cell or more off a body's middle.
    """
    rho = corner_bound(spacing, finest)
    if rho == 0.0:
        raise ValueError(
            f"surface cells of {max(spacing):.4g} m are too coarse for a smoothing "
            f"radius of {finest:.4g} m: use cells of at most {0.5 * finest:.4g} m"
        )
    least = MIN_SHIFT_AT_BODIES if bodies else MIN_SHIFT
    cell = np.array(spacing)
    diagonal = float(np.linalg.norm(cell))
    return {
        "air_below": MARGIN * rho * (ISO + least),
        "deep_above": 1.0 - MARGIN * rho * (1.0 - ISO - MAX_SHIFT),
        "overlap": min(diagonal, max(thinnest - 0.5 * cell.max(), 0.0)),
        "half_diagonal": 0.5 * STRIDE * diagonal,
        "block_edges": STRIDE * cell,
        "min_shift": least,
        "max_shift": MAX_SHIFT,
    }


@data_oriented
class Band:
    """States of the sub-blocks, the tiles to evaluate, and the signs of all other nodes.

    Call sample(), classify() and include_thin() in this order. sampled f32: coverage (-) at every
    second node along each axis; a ghost has the value of the adjacent wall node. state i32: AIR,
    BAND or DEEP of each sub-block, AIR outside the lattice. Both are flat, with as many entries
    along each axis as the lattice has pairs of nodes. near u32, in the order of signs.read: a bit
    for each BAND sub-block, in the lowest 16 bits of each word. tiles i32: indices of the tiles to
    evaluate; the first count[None] are valid. signs.read and signs.deep: see Signs.
    """

    def __init__(self, signs: Signs, sums: KernelSums, room: SurfaceRoom):
        self.lattice, self.numbers = signs.lattice, signs.numbers
        self.signs, self.sums = signs, sums
        self.thin, self.bodies = sums.thin, sums.bodies
        self.sampled = ti.field(ti.f32, shape=room.nodes // PAIR**3)
        self.state = ti.field(ti.i32, shape=room.nodes // PAIR**3)
        self.near = ti.field(ti.u32, shape=signs.pair_room)
        self.tiles = ti.field(ti.i32, shape=room.nodes // TILE)
        self.count = ti.field(ti.i32, shape=())

    @heavy_kernel
    def sample(self, bodies: ti.template()):
        """Computes sampled from the particles."""
        tiles = (self.numbers.pairs[None] + ti.Vector([1, 1, RUN - 1])) // ti.Vector(
            [PAIR, PAIR, RUN]
        )
        for q in range(tiles[0] * tiles[1] * tiles[2]):
            size, last = self.numbers.pairs[None], self.numbers.nodes[None] - 1
            tb, tc = (size[1] + 1) // PAIR, (size[2] + RUN - 1) // RUN
            a, b, c = PAIR * (q // (tb * tc)), PAIR * (q // tc % tb), RUN * (q % tc)
            i = ti.math.clamp(STRIDE * (a + ti.Vector([0, 1])), 1, last[0] - 1)
            j = ti.math.clamp(STRIDE * (b + ti.Vector([0, 1])), 1, last[1] - 1)
            k = ti.math.clamp(STRIDE * (c + ti.Vector([0, 1, 2, 3])), 1, last[2] - 1)
            found = self.sums.sum_tile(i, j, k, bodies, True)[0]
            for n in range(TILE):
                at = ti.Vector([a + n // HALF_TILE, b + n // RUN % PAIR, c + n % RUN])
                if (at < size).all():
                    self.sampled[self.block_index(at)] = found[n]

    @kernel
    def classify(self, bodies: ti.template()):
        """Computes state from sampled. Separate from include_thin(), since one kernel for both is
        invalid SPIR-V, the code for Vulkan and Metal (taichi issue #8741)."""
        n = self.numbers.pairs[None]
        for q in range(n[0] * n[1] * n[2]):
            self.state[q] = self.state_of(q, bodies)

    @heavy_kernel
    def include_thin(
        self, n: ti.i32, bodies: ti.template(), frame: ti.i32, dt: ti.f32, image: ti.i32
    ):
        """Sets the kernels of the n particles (ThinWater.set_kernel), marks sub-blocks within reach
        of kernels that exceed the full one as BAND, and lists the tiles (list_tiles())."""
        self.thin.clear()
        for p in range(n):
            x = self.thin.particles.x[p]
            sub = ti.math.clamp(self.block_at(x), 0, self.last_block())
            deep = self.state[self.block_index(sub)] == DEEP
            larger = self.thin.set_kernel(p, deep, bodies, frame, dt, image)
            if larger > 0.0:
                self.mark(x, larger)
        self.list_tiles()

    @ti.func
    def block_index(self, sub):
        """Returns the index in state of a sub-block (a, b, c)."""
        n = self.numbers.pairs[None]
        return (sub[0] * n[1] + sub[1]) * n[2] + sub[2]

    @ti.func
    def last_block(self):
        """Returns the last sub-block (a, b, c) of whole cells."""
        return self.numbers.pairs[None] - 2

    @ti.func
    def list_tiles(self):
        """Computes near, tiles, signs.read and signs.deep from state. Call it at the top level of a
        kernel, where its loops run in parallel."""
        self.count[None] = 0
        for q in range(self.word_count()):
            near, deep = ti.u32(0), ti.u32(0)
            words, pairs = self.numbers.words[None], self.numbers.pairs[None]
            w, depth = q % words, pairs[2]
            first = q // words * depth + BLOCKS_PER_WORD * w
            for m in range(ti.min(BLOCKS_PER_WORD, depth - BLOCKS_PER_WORD * w)):
                state = self.state[first + m]
                near |= ti.cast(state == BAND, ti.u32) << ti.cast(m, ti.u32)
                deep |= ti.cast(state == DEEP, ti.u32) << ti.cast(m, ti.u32)
            self.near[q] = near
            self.signs.deep[q] = double_bits(deep)
        for q in range(self.word_count()):
            runs = self.runs_of(q)
            pairs = runs | runs << ti.u32(1)
            self.signs.read[q] = double_bits(pairs)
            if runs != 0:
                slot = ti.atomic_add(self.count[None], popcount(runs))
                words = self.numbers.words[None]
                first = q // words * self.numbers.runs[None] + WORD // RUN * (q % words)
                while runs != 0:
                    self.tiles[slot] = first + lowest_bit(runs) // 2
                    runs &= runs - ti.u32(1)
                    slot += 1

    @ti.func
    def word_count(self):
        """Returns the number of words of near."""
        pairs = self.numbers.pairs[None]
        return pairs[0] * pairs[1] * self.numbers.words[None]

    @ti.func
    def runs_of(self, q):
        """Returns a word with bit 2 m set if any of the nodes 4 m to 4 m + 3 of word q, in the rows
        (2 a, 2 b) to (2 a + 1, 2 b + 1), touches a BAND sub-block."""
        near, before, last = ti.u32(0), ti.u32(0), self.last_block()
        words, pairs = self.numbers.words[None], self.numbers.pairs[None]
        ny = pairs[1]
        a, b, w = q // words // ny, q // words % ny, q % words
        # The rows from `last` on are ghosts.
        if a <= last[0] and b <= last[1]:
            for s in ti.static(range(4)):
                at = (ti.max(a - (s & 1), 0) * ny + ti.max(b - (s >> 1), 0)) * words + w
                near |= self.near[at]
                if w > 0:
                    before |= self.near[at - 1]
        # The last nodes of a sub-block are the first nodes of the next pair.
        near |= near << ti.u32(1) | before >> ti.u32(BLOCKS_PER_WORD - 1)
        return (near | near >> ti.u32(1)) & ti.u32(0x5555)

    @ti.func
    def tile(self, q):
        """Returns the first node (i, j, k) of the q-th listed tile."""
        number, runs, pairs = self.tiles[q], self.numbers.runs[None], self.numbers.pairs[None]
        row, ny = number // runs, pairs[1]
        return ti.Vector([PAIR * (row // ny), PAIR * (row % ny), RUN * (number % runs)])

    @ti.func
    def block_at(self, x):
        """Returns the sub-block (a, b, c) that contains x [m]; the first one starts at the
        ghosts."""
        return ti.floor(x / self.numbers.block_edges[None] + 0.5, ti.i32)

    @ti.func
    def mark(self, x, r):
        """Sets all sub-blocks that meet a cube of half edge r [m] around x to BAND."""
        lo, hi = ti.max(self.block_at(x - r), 0), ti.min(self.block_at(x + r), self.last_block())
        for a in range(lo[0], hi[0] + 1):
            for b in range(lo[1], hi[1] + 1):
                for c in range(lo[2], hi[2] + 1):
                    self.state[self.block_index(ti.Vector([a, b, c]))] = BAND

    @ti.func
    def state_of(self, q, bodies: ti.template()):
        """Returns AIR, BAND or DEEP of the q-th sub-block from the range of its corner samples and,
        if `bodies`, from its distance to the nearest body."""
        state, n = AIR, self.numbers.pairs[None]
        sub = ti.Vector([q // (n[1] * n[2]), q // n[2] % n[1], q % n[2]])
        if (self.last_block() - sub).min() >= 0:
            least, most = 1e9, 0.0
            for s in range(8):
                c = self.sampled[q + ((s & 1) * n[1] + (s >> 1 & 1)) * n[2] + (s >> 2)]
                least, most = ti.min(least, c), ti.max(most, c)
            if least > self.numbers.deep_above[None]:
                state = DEEP
            elif most > self.numbers.air_below[None]:
                state = BAND
            if ti.static(bodies):
                if state != AIR:
                    near = self.bodies.clearance(self.lattice.point(STRIDE * sub + 1))
                    if near < -self.numbers.half_diagonal[None] - self.numbers.overlap[None]:
                        state = AIR
                    elif near < self.numbers.half_diagonal[None]:
                        state = BAND
        return state


@ti.func
def double_bits(word):
    """Returns a word whose bits 2 k and 2 k + 1 are bit k of the given word, for k below 16."""
    for shift, mask in ti.static(SPREAD_STEPS):
        word = (word | word << ti.u32(shift)) & ti.u32(mask)
    return word | word << ti.u32(1)
