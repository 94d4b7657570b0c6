"""Where the surface can pass: samples of the coverage sort the box into air, band and deep water.

Coverage is sampled at every second lattice node. A sub-block, the 2^3 cells between eight
samples, is then skipped by the following bound.

Let a particle at p add w(x - p) to the coverage at x inside a sub-block of diagonal D. The
trilinear interpolation of w from the eight corners is at least rho w(x) - RIM w(0), where
rho = (1 - D^2/(4 r^2))^3 for poly6 with reach r is its value in the middle of the sub-block, with
the particle right there. (Checked by sampling in the tests. RIM is a small loss at the kernel's
rim: there some corners see nothing of a particle that x still sees.) Summed over particles, some
corner holds at least rho c(x). So if all corners hold less than rho iso, no node inside reaches
iso: air. The same bound on the missing water 1 - c, again a sum of kernels over what is not
water, says: if all corners hold more than 1 - rho (1 - iso), no node inside falls below iso:
deep. The first holds for any particles; the second assumes that water elsewhere is not packed
denser than at rest. A margin covers the rim and ordinary noise of the density.
Both allow for the shift of iso that sets the water's volume right (water_volume.py).

Both bounds are of kernels of full reach. Where those of thin water (thin_water.py) are larger, it
is band, whatever the samples say. So is what a body's surface crosses, unless it is air.
"""

import numpy as np
import taichi as ti

from msph.surface.device_lattice import WORD
from msph.surface.fluid_fraction import ISO
from msph.surface.lattice import PAIR, RUN
from msph.surface.room import SurfaceRoom
from msph.surface.signs import Signs, count, lowest
from msph.surface.sums import SIDE, TILE, KernelSums
from msph.surface.water_volume import shift_bounds
from msph.taichi_internals import data_oriented, kernel

AIR, BAND, DEEP = 0, 1, 2
STRIDE = PAIR  # lattice intervals per sample
# Sub-blocks along z in a word of signs.
SUBS = WORD // STRIDE
# Steps that part the lowest 16 bits of a word to every second place: shifts and masks.
SPREAD = ((8, 0x00FF00FF), (4, 0x0F0F0F0F), (2, 0x33333333), (1, 0x55555555))
RIM = 0.016
# Part of the bounds used. The rest is for the rim and for noise of the density in deep water.
MARGIN = 0.9


def bound(spacing: tuple[float, float, float], reach: float) -> float:
    """rho of the module's text; 0 where it tells nothing."""
    diagonal2 = sum((STRIDE * s) ** 2 for s in spacing)
    return max(0.0, 1.0 - diagonal2 / (4.0 * reach * reach)) ** 3


def band_numbers(spacing: tuple[float, float, float], finest: float, bodies: bool) -> dict:
    """Numbers of the scene that a Band reads, for nodes `spacing` [m] apart and kernels of reach
    `finest` [m] and more. Raises ValueError if cells are too coarse."""
    rho = bound(spacing, finest)
    if rho == 0.0:
        raise ValueError(
            f"surface cells of {max(spacing):.4g} m are too coarse for a smoothing "
            f"radius of {finest:.4g} m: use cells of at most {0.5 * finest:.4g} m"
        )
    least, most = shift_bounds(bodies)
    edges = STRIDE * np.array(spacing)
    return {
        "air_below": MARGIN * rho * (ISO + least),
        "deep_above": 1.0 - MARGIN * rho * (1.0 - ISO - most),
        "half": 0.5 * float(np.linalg.norm(edges)),
        "edges": edges,
        "least": least,
        "most": most,
    }


@data_oriented
class Band:
    """Sub-block states, and from them the tiles of nodes to evaluate and the signs of all others.

    sampled f32: coverage at every second node (i, j, k), ghosts at the wall node next to them;
    state i32: AIR, BAND or DEEP per 2^3 cells, AIR outside the lattice; both flat, with as many
    along each axis as the lattice has pairs. near u32, in the order of signs.read: sub-blocks that
    are BAND, the lowest 16 bits of a word; tiles i32: numbers of the tiles (of sums.py) to
    evaluate, the first count[None] of them live.
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

    def find(self, bodies: bool) -> None:
        """particles -> state, tiles and signs."""
        self.sample(bodies)
        self.classify(bodies)
        self.include_thin(self.thin.particles.count, bodies)

    @kernel
    def everywhere(self, n: ti.i32, bodies: ti.template()):
        """All of the box is band, and kernels of the n particles are wherever they are: the plain
        way, to compare with."""
        self.thin.volume[None] = 0.0
        for q in range(self.blocks()):
            self.state[q] = BAND
        for p in range(n):
            self.thin.find(p, False, bodies)
        self.list_tiles()

    @kernel
    def sample(self, bodies: ti.template()):
        """sampled = c at every second node."""
        for q in range(self.sample_tiles()):
            size, last = self.numbers.pairs[None], self.numbers.nodes[None] - 1
            tb, tc = (size[1] + 1) // PAIR, (size[2] + RUN - 1) // RUN
            a, b, c = PAIR * (q // (tb * tc)), PAIR * (q // tc % tb), RUN * (q % tc)
            i, j, k = ti.math.ivec2(0), ti.math.ivec2(0), ti.math.ivec4(0)
            for m in ti.static(range(PAIR)):
                i[m] = ti.math.clamp(STRIDE * (a + m), 1, last[0] - 1)
                j[m] = ti.math.clamp(STRIDE * (b + m), 1, last[1] - 1)
            for m in ti.static(range(RUN)):
                k[m] = ti.math.clamp(STRIDE * (c + m), 1, last[2] - 1)
            beside = False
            if ti.static(bodies):
                beside = self.sums.beside_bodies(i, j, k)
            found = self.sums.at_tile(i, j, k, bodies, beside, True)[0]
            for n in range(TILE):
                at = ti.Vector([a + n // SIDE, b + n // RUN % PAIR, c + n % RUN])
                if (at < size).all():
                    self.sampled[self.block(at)] = found[n]

    @kernel
    def classify(self, bodies: ti.template()):
        """sampled -> state. A kernel of its own: of both, with bodies, Taichi makes invalid SPIR-V,
        code for Vulkan and Metal (taichi issue #8741)."""
        for q in range(self.blocks()):
            self.state[q] = self.state_of(q, bodies)

    @kernel
    def include_thin(self, n: ti.i32, bodies: ti.template()):
        """Finds kernels of the n particles; all that is thin is band."""
        self.thin.volume[None] = 0.0
        for p in range(n):
            x = self.thin.particles.x[p]
            sub = ti.math.clamp(self.sub_block(x), 0, self.last_sub())
            larger = self.thin.find(p, self.state[self.block(sub)] == DEEP, bodies)
            if larger > 0.0:
                self.mark(x, larger)
        self.list_tiles()

    @ti.func
    def sample_tiles(self):
        """Tiles of samples."""
        n = self.numbers.pairs[None]
        return (n[0] + 1) // PAIR * ((n[1] + 1) // PAIR) * ((n[2] + RUN - 1) // RUN)

    @ti.func
    def blocks(self):
        """Sub-blocks, those that begin at the last nodes too."""
        n = self.numbers.pairs[None]
        return n[0] * n[1] * n[2]

    @ti.func
    def block(self, sub):
        """Index of a sub-block (a, b, c)."""
        n = self.numbers.pairs[None]
        return (sub[0] * n[1] + sub[1]) * n[2] + sub[2]

    @ti.func
    def last_sub(self):
        """The last sub-block of whole cells."""
        return self.numbers.pairs[None] - 2

    @ti.func
    def list_tiles(self):
        """The same within a kernel, at its top level, where its loops are shared out."""
        self.count[None] = 0
        for q in range(self.words()):
            near, deep = ti.u32(0), ti.u32(0)
            words, pairs = self.numbers.words[None], self.numbers.pairs[None]
            w, depth = q % words, pairs[2]
            first = q // words * depth + SUBS * w
            for m in range(ti.min(SUBS, depth - SUBS * w)):
                state = self.state[first + m]
                near |= ti.cast(state == BAND, ti.u32) << ti.cast(m, ti.u32)
                deep |= ti.cast(state == DEEP, ti.u32) << ti.cast(m, ti.u32)
            self.near[q] = near
            self.signs.deep[q] = doubled(deep)
        for q in range(self.words()):
            runs = self.runs_of(q)
            pairs = runs | runs << ti.u32(1)
            self.signs.read[q] = doubled(pairs)
            if runs != 0:
                slot = ti.atomic_add(self.count[None], count(runs))
                words = self.numbers.words[None]
                first = q // words * self.numbers.runs[None] + WORD // RUN * (q % words)
                while runs != 0:
                    self.tiles[slot] = first + lowest(runs) // 2
                    runs &= runs - ti.u32(1)
                    slot += 1

    @ti.func
    def words(self):
        """Words of all pairs of rows."""
        pairs = self.numbers.pairs[None]
        return pairs[0] * pairs[1] * self.numbers.words[None]

    @ti.func
    def runs_of(self, q):
        """Bits 2 q: of the 4 nodes from 4 q on in the rows (2 a, 2 b) to (2 a + 1, 2 b + 1) of a
        word, some touch a BAND sub-block."""
        near, before, last = ti.u32(0), ti.u32(0), self.last_sub()
        words, pairs = self.numbers.words[None], self.numbers.pairs[None]
        ny = pairs[1]
        a, b, w = q // words // ny, q // words % ny, q % words
        # The rows (last, ..) are ghosts, as are those beyond.
        if a <= last[0] and b <= last[1]:
            for s in ti.static(range(4)):
                at = (ti.max(a - (s & 1), 0) * ny + ti.max(b - (s >> 1), 0)) * words + w
                near |= self.near[at]
                if w > 0:
                    before |= self.near[at - 1]
        # A sub-block's last nodes are the first of the next pair.
        near |= near << ti.u32(1) | before >> ti.u32(SUBS - 1)
        return (near | near >> ti.u32(1)) & ti.u32(0x5555)

    @ti.func
    def tile(self, q):
        """First node (i, j, k) of the q-th tile listed."""
        number, runs, pairs = self.tiles[q], self.numbers.runs[None], self.numbers.pairs[None]
        row, ny = number // runs, pairs[1]
        return ti.Vector([PAIR * (row // ny), PAIR * (row % ny), RUN * (number % runs)])

    @ti.func
    def sub_block(self, x):
        """The sub-block that holds x [m]; the first begins at the ghosts, one interval before the
        wall."""
        return ti.floor(x / self.numbers.edges[None] + 0.5, ti.i32)

    @ti.func
    def mark(self, x, r):
        """All sub-blocks within a cube round x, of half edge r [m], are band."""
        lo, hi = ti.max(self.sub_block(x - r), 0), ti.min(self.sub_block(x + r), self.last_sub())
        for a in range(lo[0], hi[0] + 1):
            for b in range(lo[1], hi[1] + 1):
                for c in range(lo[2], hi[2] + 1):
                    self.state[self.block(ti.Vector([a, b, c]))] = BAND

    @ti.func
    def state_of(self, q, bodies: ti.template()):
        """AIR, BAND or DEEP by the least and greatest of the q-th sub-block's corner samples."""
        state, n = AIR, self.numbers.pairs[None]
        sub = ti.Vector([q // (n[1] * n[2]), q // n[2] % n[1], q % n[2]])
        if (self.last_sub() - sub).min() >= 0:
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
                    if near < -self.numbers.half[None]:
                        state = AIR
                    elif near < self.numbers.half[None]:
                        state = BAND
        return state


@ti.func
def doubled(word):
    """Bit k of the lowest 16 at 2 k and 2 k + 1."""
    for shift, mask in ti.static(SPREAD):
        word = (word | word << ti.u32(shift)) & ti.u32(mask)
    return word | word << ti.u32(1)
