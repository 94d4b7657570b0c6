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

import math

import taichi as ti

from msph.surface.fluid_fraction import ISO
from msph.surface.lattice import PAIR, RUN, Lattice
from msph.surface.signs import WORD, Signs, count, lowest, words_of
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


@data_oriented
class Band:
    """Sub-block states, and from them the tiles of nodes to evaluate and the signs of all others.

    sampled (sx, sy, sz) f32: coverage at every second node, ghosts at the wall node next to them;
    state (nx/2, ny/2, nz/2) i32: AIR, BAND or DEEP per 2^3 cells, AIR outside the lattice; near,
    of the shape of signs.read, u32: sub-blocks that are BAND, the lowest 16 bits of a word; tiles
    i32: numbers of the tiles (of sums.py) to evaluate, the first count[None] of them live.
    """

    def __init__(self, lattice: Lattice, signs: Signs, sums: KernelSums):
        self.lattice, self.signs, self.sums = lattice, signs, sums
        self.thin, self.bodies = sums.thin, sums.bodies
        self.has_bodies = self.bodies is not None
        finest = float(self.thin.radii.min())
        rho = bound(lattice.spacing, finest)
        if rho == 0.0:
            raise ValueError(
                f"surface cells of {max(lattice.spacing):.4g} m are too coarse for a smoothing "
                f"radius of {finest:.4g} m: use cells of at most {0.5 * finest:.4g} m"
            )
        least, most = shift_bounds(self.has_bodies)
        self.air_below = MARGIN * rho * (ISO + least)
        self.deep_above = 1.0 - MARGIN * rho * (1.0 - ISO - most)
        # Half the diagonal of a sub-block, and its edges [m].
        self.half = 0.5 * STRIDE * math.hypot(*lattice.spacing)
        self.edges = STRIDE * ti.Vector(list(lattice.spacing))
        self.last_node = ti.math.ivec3(*(n - 1 for n in lattice.shape))
        self.shape = sample_shape(lattice.shape)
        self.last_sub = ti.math.ivec3(*(n - 2 for n in self.shape))
        self.sampled = ti.field(ti.f32, shape=self.shape)
        self.state = ti.field(ti.i32, shape=state_shape(lattice.shape))
        self.near = ti.field(ti.u32, shape=signs.read.shape)
        self.runs = lattice.padded[2] // RUN
        self.tiles = ti.field(ti.i32, shape=tile_count(lattice.shape))
        self.count = ti.field(ti.i32, shape=())

    @staticmethod
    def bytes_needed(shape: tuple[int, int, int]) -> int:
        subs, samples = math.prod(state_shape(shape)), math.prod(sample_shape(shape))
        words = subs // state_shape(shape)[2] * words_of(shape[2])
        return 4 * (subs + samples + words + tile_count(shape))

    def find(self) -> None:
        """particles -> state, tiles and signs."""
        self.sample()
        self.classify(self.thin.particles.count)

    def everywhere(self) -> None:
        """Evaluate all of the box: the plain way, to compare with."""
        self.state.fill(BAND)
        self.thin.find_all(self.thin.particles.count)
        self.enlist()

    @kernel
    def sample(self):
        """sampled = c at every second node."""
        nx, ny, nz = self.shape
        ta, tb, tc = (nx + 1) // PAIR, (ny + 1) // PAIR, (nz + RUN - 1) // RUN
        for q in range(ta * tb * tc):
            a, b, c = PAIR * (q // (tb * tc)), PAIR * (q // tc % tb), RUN * (q % tc)
            i, j, k = ti.math.ivec2(0), ti.math.ivec2(0), ti.math.ivec4(0)
            for m in ti.static(range(PAIR)):
                i[m] = ti.math.clamp(STRIDE * (a + m), 1, self.last_node[0] - 1)
                j[m] = ti.math.clamp(STRIDE * (b + m), 1, self.last_node[1] - 1)
            for m in ti.static(range(RUN)):
                k[m] = ti.math.clamp(STRIDE * (c + m), 1, self.last_node[2] - 1)
            beside = self.sums.beside_bodies(i, j, k)
            found = self.sums.at_tile(i, j, k, beside, True)[0]
            for n in range(TILE):
                at = ti.Vector([a + n // SIDE, b + n // RUN % PAIR, c + n % RUN])
                if at[0] < nx and at[1] < ny and at[2] < nz:
                    self.sampled[at] = found[n]

    @kernel
    def classify(self, n: ti.i32):
        """sampled -> state; kernels of the n particles, and all that is thin is band."""
        self.thin.volume[None] = 0.0
        for sub in ti.grouped(self.state):
            self.state[sub] = self.state_of(sub)
        for p in range(n):
            x = self.thin.particles.x[p]
            sub = ti.math.clamp(self.sub_block(x), 0, self.last_sub)
            larger = self.thin.find(p, self.state[sub] == DEEP)
            if larger > 0.0:
                self.mark(x, larger)
        self.list_tiles()

    @kernel
    def enlist(self):
        """state -> tiles and signs."""
        self.list_tiles()

    @ti.func
    def list_tiles(self):
        """The same within a kernel, at its top level, where its loops are shared out."""
        self.count[None] = 0
        for a, b, w in self.near:
            near, deep = ti.u32(0), ti.u32(0)
            for m in range(ti.min(SUBS, self.state.shape[2] - SUBS * w)):
                state = self.state[a, b, SUBS * w + m]
                near |= ti.cast(state == BAND, ti.u32) << ti.cast(m, ti.u32)
                deep |= ti.cast(state == DEEP, ti.u32) << ti.cast(m, ti.u32)
            self.near[a, b, w] = near
            self.signs.deep[a, b, w] = doubled(deep)
        for a, b, w in self.near:
            runs = self.runs_of(a, b, w)
            pairs = runs | runs << ti.u32(1)
            self.signs.read[a, b, w] = doubled(pairs)
            if runs != 0:
                slot = ti.atomic_add(self.count[None], count(runs))
                first = (a * self.near.shape[1] + b) * self.runs + WORD // RUN * w
                while runs != 0:
                    self.tiles[slot] = first + lowest(runs) // 2
                    runs &= runs - ti.u32(1)
                    slot += 1

    @ti.func
    def runs_of(self, a, b, w):
        """Bits 2 q: of the 4 nodes from 4 q on in the rows (2 a, 2 b) to (2 a + 1, 2 b + 1) of a
        word, some touch a BAND sub-block."""
        near, before = ti.u32(0), ti.u32(0)
        # The rows (last, ..) are ghosts, as are those beyond.
        if a <= self.last_sub[0] and b <= self.last_sub[1]:
            for s in ti.static(range(4)):
                row = ti.max(ti.Vector([a - (s & 1), b - (s >> 1)]), 0)
                near |= self.near[row[0], row[1], w]
                if w > 0:
                    before |= self.near[row[0], row[1], w - 1]
        # A sub-block's last nodes are the first of the next pair.
        near |= near << ti.u32(1) | before >> ti.u32(SUBS - 1)
        return (near | near >> ti.u32(1)) & ti.u32(0x5555)

    @ti.func
    def tile(self, q):
        """First node (i, j, k) of the q-th tile listed."""
        number = self.tiles[q]
        row = number // self.runs
        ny = self.near.shape[1]
        return ti.Vector([PAIR * (row // ny), PAIR * (row % ny), RUN * (number % self.runs)])

    @ti.func
    def sub_block(self, x):
        """The sub-block that holds x [m]; the first begins at the ghosts, one interval before the
        wall."""
        return ti.floor(x / self.edges + 0.5, ti.i32)

    @ti.func
    def mark(self, x, r):
        """All sub-blocks within a cube round x, of half edge r [m], are band."""
        lo, hi = ti.max(self.sub_block(x - r), 0), ti.min(self.sub_block(x + r), self.last_sub)
        for a in range(lo[0], hi[0] + 1):
            for b in range(lo[1], hi[1] + 1):
                for c in range(lo[2], hi[2] + 1):
                    self.state[a, b, c] = BAND

    @ti.func
    def state_of(self, sub):
        """AIR, BAND or DEEP by the least and greatest of a sub-block's corner samples."""
        state = AIR
        if (self.last_sub - sub).min() >= 0:
            least, most = 1e9, 0.0
            for s in range(8):
                c = self.sampled[sub + ti.Vector([s & 1, s >> 1 & 1, s >> 2])]
                least, most = ti.min(least, c), ti.max(most, c)
            if least > self.deep_above:
                state = DEEP
            elif most > self.air_below:
                state = BAND
            if ti.static(self.has_bodies):
                if state != AIR:
                    near = self.bodies.clearance(self.lattice.point(*(STRIDE * sub + 1)))
                    if near < -self.half:
                        state = AIR
                    elif near < self.half:
                        state = BAND
        return state


@ti.func
def doubled(word):
    """Bit k of the lowest 16 at 2 k and 2 k + 1."""
    for shift, mask in ti.static(SPREAD):
        word = (word | word << ti.u32(shift)) & ti.u32(mask)
    return word | word << ti.u32(1)


def sample_shape(shape: tuple[int, int, int]) -> tuple[int, int, int]:
    """Samples along each axis; a walled lattice has an even number of intervals."""
    nx, ny, nz = ((n - 1) // STRIDE + 1 for n in shape)
    return nx, ny, nz


def state_shape(shape: tuple[int, int, int]) -> tuple[int, int, int]:
    """Sub-blocks along each axis, those that begin at the last nodes too."""
    nx, ny, nz = (-(-n // STRIDE) for n in shape)
    return nx, ny, nz


def tile_count(shape: tuple[int, int, int]) -> int:
    """Tiles of all the lattice."""
    nx, ny, nz = Lattice.padded_shape(shape)
    return nx * ny * nz // TILE
