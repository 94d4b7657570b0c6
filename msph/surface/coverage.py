"""The field whose zero is the surface: f = c - iso at the nodes that need it, c as in sums.py, cut
at bodies (bodies.py)."""

import taichi as ti

from msph.surface.band import Band
from msph.surface.fluid_fraction import ISO
from msph.surface.lattice import PAIR, RUN
from msph.surface.marching_cubes import MarchingCubes
from msph.surface.sums import SIDE, TILE, KernelSums
from msph.taichi_internals import data_oriented, kernel

vec3, vec4 = ti.math.vec3, ti.math.vec4

# Cut (-) where no body is near: above all f.
OPEN = 1e9


@data_oriented
class Coverage:
    """Fills value f of marching cubes, its gradient and its cut, s/l of bodies.py, at the nodes of
    the band's tiles."""

    def __init__(self, cubes: MarchingCubes, sums: KernelSums):
        self.cubes, self.sums, self.lattice = cubes, sums, cubes.lattice
        self.thin, self.bodies = sums.thin, sums.bodies
        self.has_bodies = self.bodies is not None
        self.band = Band(cubes.lattice, cubes.signs, sums)

    def run(self, everywhere: bool = False) -> None:
        """particles -> tiles, and value, gradient and cut at their nodes."""
        if everywhere:
            self.band.everywhere()
        else:
            self.band.find()
        self.gather()

    @kernel
    def gather(self):
        """f and grad f at the nodes of all listed tiles."""
        for q in range(self.band.count[None]):
            first = self.band.tile(q)
            i, j = first[0] + ti.Vector([0, 1]), first[1] + ti.Vector([0, 1])
            k = first[2] + ti.Vector([0, 1, 2, 3])
            beside = self.sums.beside_bodies(i, j, k)
            c, gx, gy, gz = self.sums.at_tile(i, j, k, beside, False)
            for n in range(TILE):
                node = first + ti.Vector([n // SIDE, n // RUN % PAIR, n % RUN])
                self.cubes.value[node] = c[n] - ISO
                self.cubes.gradient[node] = vec3(gx[n], gy[n], gz[n])
            if ti.static(self.has_bodies):
                for n in range(TILE):
                    self.cut_node(first + ti.Vector([n // SIDE, n // RUN % PAIR, n % RUN]), beside)

    @ti.func
    def cut_node(self, node, beside):
        """min(f, cut) at a node; where the body cuts, the gradient is its own."""
        cut = vec4(OPEN, 0.0, 0.0, 0.0)
        if beside:
            cut = self.bodies.cut(self.lattice.point(node[0], node[1], node[2]))
        self.cubes.cut[node] = cut[0]
        if cut[0] < self.cubes.value[node]:
            self.cubes.value[node] = cut[0]
            self.cubes.gradient[node] = cut.yzw
