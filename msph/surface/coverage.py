"""The field whose zero is the surface: f = c - iso at the nodes that need it, c as in sums.py, cut
at bodies (bodies.py)."""

import math

import taichi as ti

from msph.surface.band import AIR, BAND, Band
from msph.surface.fluid_fraction import ISO
from msph.surface.lattice import BLOCK, RUNS, Blocks, Lattice
from msph.surface.sums import KernelSums
from msph.taichi_internals import data_oriented, kernel

vec3, vec4 = ti.math.vec3, ti.math.vec4

# Values of nodes that no gather needs: only their sign is read.
INSIDE, OUTSIDE = 1.0, -1.0


@data_oriented
class Coverage:
    """Fills value f and its gradient at the nodes of the listed blocks.

    Runs of four nodes that touch no BAND sub-block only get a sign. Ghosts are always outside, so
    that marching cubes closes the water along the walls. cut (nodes) f32: s/l of bodies.py, above f
    where no body cuts; None without bodies.
    """

    def __init__(self, lattice: Lattice, blocks: Blocks, sums: KernelSums):
        self.lattice, self.blocks, self.sums = lattice, blocks, sums
        self.thin, self.bodies = sums.thin, sums.bodies
        self.has_bodies = self.bodies is not None
        self.last = ti.math.ivec3(*(n - 1 for n in lattice.shape))
        self.band = Band(lattice, blocks, sums)
        self.cut = ti.field(ti.f32, shape=lattice.padded) if self.has_bodies else None

    @staticmethod
    def bytes_needed(shape: tuple[int, int, int], bodies: bool) -> int:
        return 4 * math.prod(BLOCK * -(-n // BLOCK) for n in shape) if bodies else 0

    def run(self, value, gradient, everywhere: bool = False) -> None:
        """particles -> active blocks, and value and gradient at their nodes."""
        if everywhere:
            self.band.everywhere()
        else:
            self.band.find()
        self.gather(value, gradient)

    @ti.func
    def run_state(self, first):
        """BAND if a run of nodes touches any BAND sub-block, else the state around it."""
        state = self.band.state[first // 2]
        low = ti.max((first - 1) >> 1, 0)
        high = ti.Vector([first[0] >> 1, first[1] >> 1, (first[2] + BLOCK - 1) >> 1])
        for a in range(low[0], high[0] + 1):
            for b in range(low[1], high[1] + 1):
                for c in range(low[2], high[2] + 1):
                    if self.band.state[a, b, c] == BAND:
                        state = BAND
        return state

    @kernel
    def gather(self, value: ti.template(), gradient: ti.template()):
        """f and grad f at the nodes of all listed blocks."""
        for q in range(self.blocks.count[0] * RUNS):
            first, _ = self.blocks.run(q)
            i, j = first[0], first[1]
            if i <= self.last[0] and j <= self.last[1]:
                state = self.run_state(first)
                k = first[2] + ti.Vector([0, 1, 2, 3])
                f = vec4(ti.select(state == AIR, OUTSIDE, INSIDE))
                if i == 0 or j == 0 or i == self.last[0] or j == self.last[1]:
                    f = vec4(OUTSIDE)
                elif state == BAND:
                    beside = self.sums.beside_bodies(i, j, k)
                    c, gx, gy, gz = self.sums.at_run(i, j, k, beside, False)
                    f = c - ISO
                    for m in ti.static(range(BLOCK)):
                        gradient[i, j, k[m]] = vec3(gx[m], gy[m], gz[m])
                    if ti.static(self.has_bodies):
                        f = self.cut_run(f, i, j, k, beside, gradient)
                elif ti.static(self.has_bodies):
                    for m in ti.static(range(BLOCK)):
                        self.cut[i, j, k[m]] = INSIDE
                for m in ti.static(range(BLOCK)):
                    ghost = k[m] == 0 or k[m] >= self.last[2]
                    value[i, j, k[m]] = ti.select(ghost, OUTSIDE, f[m])

    @ti.func
    def cut_run(self, f, i, j, k, beside, gradient: ti.template()):
        """min(f, cut) at four nodes; where the body cuts, the gradient is its own."""
        for m in range(BLOCK):
            cut = vec4(INSIDE, 0.0, 0.0, 0.0)
            if beside:
                cut = self.bodies.cut(self.lattice.point(i, j, k[m]))
            self.cut[i, j, k[m]] = cut[0]
            if cut[0] < f[m]:
                f[m] = cut[0]
                gradient[i, j, k[m]] = cut.yzw
        return f
