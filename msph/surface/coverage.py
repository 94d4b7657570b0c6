"""The field whose zero is the surface: f = c - iso at the nodes that need it, c as in sums.py, cut
at bodies (bodies.py)."""

import taichi as ti

from msph.surface.band import Band
from msph.surface.fluid_fraction import ISO
from msph.surface.lattice import PAIR, RUN
from msph.surface.marching_cubes import OPEN, MarchingCubes
from msph.surface.room import SurfaceRoom
from msph.surface.sums import SIDE, TILE, KernelSums
from msph.taichi_internals import data_oriented, kernel

vec3 = ti.math.vec3


@data_oriented
class Coverage:
    """Fills value f of marching cubes, its gradient and its cut, s/l of bodies.py, at the nodes of
    the band's tiles."""

    def __init__(self, cubes: MarchingCubes, sums: KernelSums, room: SurfaceRoom):
        self.cubes, self.sums, self.lattice = cubes, sums, cubes.lattice
        self.thin, self.bodies = sums.thin, sums.bodies
        self.band = Band(cubes.signs, sums, room)

    def run(self, bodies: bool, everywhere: bool = False) -> None:
        """particles -> tiles, and value, gradient and cut at their nodes. bodies: whether the scene
        has any."""
        if everywhere:
            self.band.everywhere(self.thin.particles.count, bodies)
        else:
            self.band.find(bodies)
        self.gather(bodies)

    @kernel
    def gather(self, bodies: ti.template()):
        """f and grad f at the nodes of all listed tiles."""
        for q in range(self.band.count[None]):
            first = self.band.tile(q)
            i, j = first[0] + ti.Vector([0, 1]), first[1] + ti.Vector([0, 1])
            k = first[2] + ti.Vector([0, 1, 2, 3])
            beside = False
            if ti.static(bodies):
                beside = self.sums.beside_bodies(i, j, k)
            c, gx, gy, gz = self.sums.at_tile(i, j, k, bodies, beside, False)
            for n in range(TILE):
                node = first + ti.Vector([n // SIDE, n // RUN % PAIR, n % RUN])
                at = self.lattice.at(node)
                self.cubes.value[at], self.cubes.cut[at] = c[n] - ISO, OPEN
                self.cubes.gradient[at] = vec3(gx[n], gy[n], gz[n])
                if ti.static(bodies):
                    if beside:
                        self.cut_node(node, at)

    @ti.func
    def cut_node(self, node, at):
        """min(f, cut) at a node, `at` its index; where the body cuts, the gradient is its own."""
        cut = self.bodies.cut(self.lattice.point(node))
        self.cubes.cut[at] = cut[0]
        if cut[0] < self.cubes.value[at]:
            self.cubes.value[at] = cut[0]
            self.cubes.gradient[at] = cut.yzw
