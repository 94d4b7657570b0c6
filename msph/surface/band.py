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
from msph.surface.lattice import BLOCK, Blocks, Lattice
from msph.surface.sums import KernelSums
from msph.surface.water_volume import shift_bounds
from msph.taichi_internals import data_oriented, kernel

AIR, BAND, DEEP = 0, 1, 2
STRIDE = 2  # lattice intervals per sample
RIM = 0.016
# Part of the bounds used. The rest is for the rim and for noise of the density in deep water.
MARGIN = 0.9


def bound(spacing: tuple[float, float, float], reach: float) -> float:
    """rho of the module's text; 0 where it tells nothing."""
    diagonal2 = sum((STRIDE * s) ** 2 for s in spacing)
    return max(0.0, 1.0 - diagonal2 / (4.0 * reach * reach)) ** 3


@data_oriented
class Band:
    """Sub-block states, and from them the active blocks.

    sampled (sx, sy, sz) f32: coverage at every second node, ghosts at the wall node next to them;
    state (2 bx, 2 by, 2 bz) i32: AIR, BAND or DEEP per 2^3 cells, AIR outside the lattice.
    """

    def __init__(self, lattice: Lattice, blocks: Blocks, sums: KernelSums):
        self.lattice, self.blocks, self.sums = lattice, blocks, sums
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
        self.state = ti.field(ti.i32, shape=[2 * b for b in blocks.dims])

    @staticmethod
    def bytes_needed(shape: tuple[int, int, int]) -> int:
        subs = math.prod(2 * -(-n // BLOCK) for n in shape)
        return 4 * (math.prod(sample_shape(shape)) + subs)

    def find(self) -> None:
        """particles -> state, and the blocks' active flags and list."""
        self.sample()
        self.classify(self.thin.particles.count)

    def everywhere(self) -> None:
        """Evaluate all of the box: the plain way, to compare with."""
        self.state.fill(BAND)
        self.thin.find_all(self.thin.particles.count)
        self.blocks.activate_all()

    @kernel
    def sample(self):
        """sampled = c at every second node, four along z at once."""
        nx, ny, nz = self.shape
        runs = ti.static((self.shape[2] + 3) // 4)
        for q in range(nx * ny * runs):
            a, b, c = q // (ny * runs), q // runs % ny, 4 * (q % runs)
            i = ti.math.clamp(STRIDE * a, 1, self.last_node[0] - 1)
            j = ti.math.clamp(STRIDE * b, 1, self.last_node[1] - 1)
            k = ti.math.ivec4(0)
            for m in ti.static(range(4)):
                k[m] = ti.math.clamp(STRIDE * (c + m), 1, self.last_node[2] - 1)
            beside = self.sums.beside_bodies(i, j, k)
            found = self.sums.at_run(i, j, k, beside, True)[0]
            for m in ti.static(range(4)):
                if c + m < nz:
                    self.sampled[a, b, c + m] = found[m]

    @kernel
    def classify(self, n: ti.i32):
        """sampled -> state; kernels of the n particles, and all that is thin is band; active blocks
        -> list of needed blocks."""
        self.thin.volume[None] = 0.0
        self.blocks.count[0] = 0
        for number in range(self.blocks.total):
            block = self.blocks.place(number)
            active = 0
            for s in range(8):
                sub = 2 * block + ti.Vector([s & 1, s >> 1 & 1, s >> 2])
                state = self.state_of(sub)
                self.state[sub] = state
                active |= ti.cast(state == BAND or (state == DEEP and self.at_wall(sub)), ti.i32)
            self.blocks.active[block] = active
        for p in range(n):
            x = self.thin.particles.x[p]
            sub = ti.math.clamp(self.sub_block(x), 0, self.last_sub)
            larger = self.thin.find(p, self.state[sub] == DEEP)
            if larger > 0.0:
                self.mark(x, larger)
        for number in range(self.blocks.total):
            block = self.blocks.place(number)
            self.blocks.note_need(block[0], block[1], block[2])

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
                    if self.state[a, b, c] != BAND:
                        self.state[a, b, c] = BAND
                        self.blocks.active[a // 2, b // 2, c // 2] = 1

    @ti.func
    def at_wall(self, sub):
        """Whether a sub-block holds ghost nodes."""
        return sub.min() == 0 or (self.last_sub - sub).min() == 0

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


def sample_shape(shape: tuple[int, int, int]) -> tuple[int, int, int]:
    """SampledFields along each axis; a walled lattice has an even number of intervals."""
    nx, ny, nz = ((n - 1) // STRIDE + 1 for n in shape)
    return nx, ny, nz
