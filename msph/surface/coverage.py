"""The field whose zero is the surface: f = c - iso at the nodes that need it, c as in sums.py."""

import taichi as ti

from msph.surface.band import AIR, BAND, Band
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
    that marching cubes closes the water along the walls.
    """

    def __init__(self, lattice: Lattice, blocks: Blocks, sums: KernelSums, iso: float):
        self.blocks, self.sums, self.iso = blocks, sums, iso
        self.last = ti.math.ivec3(*(n - 1 for n in lattice.shape))
        self.band = Band(lattice, blocks, sums, iso)

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
                f = vec4(ti.select(state == AIR, OUTSIDE, INSIDE))
                if i == 0 or j == 0 or i == self.last[0] or j == self.last[1]:
                    f = vec4(OUTSIDE)
                elif state == BAND:
                    k = first[2] + ti.Vector([0, 1, 2, 3])
                    c, gx, gy, gz = self.sums.at_run(i, j, k)
                    f = c - self.iso
                    for m in ti.static(range(BLOCK)):
                        gradient[i, j, k[m]] = vec3(gx[m], gy[m], gz[m])
                for m in ti.static(range(BLOCK)):
                    k = first[2] + m
                    value[i, j, k] = ti.select(k == 0 or k >= self.last[2], OUTSIDE, f[m])
