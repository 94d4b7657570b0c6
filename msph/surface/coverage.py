"""Evaluation of f = c - iso at the nodes of the band, with c of sums.py, cut at bodies
(bodies.py)."""

import taichi as ti

from msph.surface.band import Band
from msph.surface.fluid_fraction import ISO
from msph.surface.lattice import PAIR, RUN
from msph.surface.marching_cubes import NO_CUT, MarchingCubes
from msph.surface.room import SurfaceRoom
from msph.surface.sums import HALF_TILE, TILE, KernelSums
from msph.taichi_internals import data_oriented, kernel

vec3 = ti.math.vec3


@data_oriented
class Coverage:
    """Computes value, gradient and cut of the marching cubes at the nodes of the band's tiles."""

    def __init__(self, cubes: MarchingCubes, sums: KernelSums, room: SurfaceRoom):
        self.cubes, self.sums, self.lattice = cubes, sums, cubes.lattice
        self.bodies = sums.bodies
        self.band = Band(cubes.signs, sums, room)

    @kernel
    def gather(self, bodies: ti.template()):
        """Computes f, its gradient and its cut at the nodes of all listed tiles."""
        for q in range(self.band.count[None]):
            first = self.band.tile(q)
            i, j = first[0] + ti.Vector([0, 1]), first[1] + ti.Vector([0, 1])
            k = first[2] + ti.Vector([0, 1, 2, 3])
            near_body = False
            if ti.static(bodies):
                near_body = self.sums.near_bodies(i, j, k)
            c, gx, gy, gz = self.sums.sum_tile(i, j, k, bodies, near_body, False)
            for n in range(TILE):
                node = first + ti.Vector([n // HALF_TILE, n // RUN % PAIR, n % RUN])
                at = self.lattice.node_index(node)
                self.cubes.value[at], self.cubes.cut[at] = c[n] - ISO, NO_CUT
                self.cubes.gradient[at] = vec3(gx[n], gy[n], gz[n])
                if ti.static(bodies):
                    if near_body:
                        cut = self.bodies.cut(self.lattice.point(node))
                        self.cubes.cut[at] = cut[0]
                        if cut[0] < self.cubes.value[at]:
                            self.cubes.value[at] = cut[0]
                            self.cubes.gradient[at] = cut.yzw
