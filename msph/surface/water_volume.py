"""The volume that half coverage encloses, and the change of iso by which it becomes the water's.

Coverage draws no mixture of air and water true to its volume: gaps of less than a spacing are drawn
as water (up to 4 % too much in a splash), and particles of a surface at rest lie closer than in a
lattice (.07 to .1 spacings too low). So f is shifted by Newton's method, two steps if it is far,

    shift = (V - V of all particles) / (dV/df),

a coat of equal thickness on all surfaces, of a tenth of a spacing in most scenes. V is the
volume of the mesh that marching cubes is about to make: with corners x on cell edges,

    V = sum over triangles a . (b x c)/6,
    dV/df = sum over triangles (b - a) x (c - a)/2 . (dx_a + dx_b + dx_c)/(3 df).

Volume controls of this kind: Kim, Liu, Llamas, Jiao and Rossignac 2007 for level sets.
"""

import taichi as ti

from msph.surface.lattice import BLOCK, RUNS, Blocks
from msph.surface.marching_cubes import MarchingCubes
from msph.surface.thin_water import ThinWater
from msph.taichi_internals import data_oriented, kernel

vec3 = ti.math.vec3

# Largest shift (-), .16 spacings less: at most the start of `dam_break` takes so much.
MOST = 0.08
# Least shift, a coat of .2 spacings; and with bodies: particles crowd at them, and half coverage
# lies up to .34 spacings too low (`bowl`).
LEAST, LEAST_AT_BODIES = -0.1, -0.2
# Shift (-) beyond which a step of Newton's method leaves an error of up to 3 %, and a second one is
# made; below it the error stays below .6 %.
FAR = 0.08
# Least dV/df [m^3], in volumes of particles: against division by zero.
TINY = 1e-6


def shift_bounds(has_bodies: bool) -> tuple[float, float]:
    """Least and largest shift (-)."""
    return (LEAST_AT_BODIES if has_bodies else LEAST), MOST


@data_oriented
class WaterVolume:
    """enclosed and change [m^3]: V and dV/df; step and shift (-): the last step's and that of all.

    cut: what bodies impose on f, None without bodies.
    """

    def __init__(self, blocks: Blocks, cubes: MarchingCubes, thin: ThinWater, cut):
        self.blocks, self.cubes, self.thin, self.cut = blocks, cubes, thin, cut
        self.lattice, self.has_bodies = cubes.lattice, cut is not None
        self.least, self.most = shift_bounds(self.has_bodies)
        self.enclosed, self.change = ti.field(ti.f32, shape=()), ti.field(ti.f32, shape=())
        self.step, self.shift = ti.field(ti.f32, shape=()), ti.field(ti.f32, shape=())

    def set_right(self) -> None:
        """f -> f - shift at all nodes of the listed blocks; where bodies cut, they go on to."""
        self.approach(0)
        self.approach(1)

    @kernel
    def approach(self, again: ti.i32):
        """One step; again: whether it is the second, which is made only after a far one."""
        runs = self.blocks.count[0] * RUNS
        if again == 0:
            self.shift[None] = 0.0
        elif abs(self.shift[None]) < FAR:
            runs = 0
        self.enclosed[None], self.change[None] = 0.0, 0.0
        for q in range(runs):
            first, need = self.blocks.run(q)
            cases = 0
            if need & 1 != 0:
                cases = self.cubes.cases_of(first)
            volume, change = 0.0, 0.0
            for k in range(BLOCK):
                cell, case = first + ti.Vector([0, 0, k]), cases >> (8 * k) & 255
                for t in range(self.cubes.triangle_count[case]):
                    part = self.triangle(cell, case, t)
                    volume += part[0]
                    change += part[1]
            if volume != 0.0:
                self.enclosed[None] += volume
                self.change[None] += change
        if runs > 0:
            self.find_step()
        for q in range(runs):
            first, _ = self.blocks.run(q)
            for k in range(BLOCK):
                node = first + ti.Vector([0, 0, k])
                f = self.cubes.value[node]
                if ti.static(self.has_bodies):
                    if f < self.cut[node]:
                        self.cubes.value[node] = ti.min(f - self.step[None], self.cut[node])
                else:
                    self.cubes.value[node] = f - self.step[None]

    @ti.func
    def find_step(self):
        """Newton's step, as far as the shift stays within its bounds."""
        rest, before = self.thin.volume[None], self.shift[None]
        step = (self.enclosed[None] - rest) / ti.max(self.change[None], TINY * rest)
        self.shift[None] = ti.math.clamp(before + step, self.least, self.most)
        self.step[None] = self.shift[None] - before

    @ti.func
    def triangle(self, cell, case, t):
        """Parts of the t-th triangle of a cell in V and in dV/df [m^3]."""
        a, da = self.corner(cell, self.cubes.triangle_edge[case, t, 0])
        b, db = self.corner(cell, self.cubes.triangle_edge[case, t, 1])
        c, dc = self.corner(cell, self.cubes.triangle_edge[case, t, 2])
        volume = a.dot(b.cross(c)) / 6.0
        return ti.Vector([volume, (b - a).cross(c - a).dot(da + db + dc) / 6.0])

    @ti.func
    def corner(self, cell, e):
        """Place [m] of the vertex on edge e of a cell, and its derivative by f [m]."""
        low, way = ti.Vector([0, 0, 0]), ti.Vector([0, 0, 0])
        for a in ti.static(range(3)):
            low[a] = cell[a] + self.cubes.edge[e, a]
            way[a] = ti.cast(self.cubes.edge[e, 3] == a, ti.i32)
        far = low + way
        f0, f1 = self.cubes.value[low], self.cubes.value[far]
        t, change = f0 / (f0 - f1), 1.0 / (f0 - f1)
        if self.cubes.at_wall(low, far):
            t, change = 0.5, 0.0
        if ti.static(self.has_bodies):
            if f0 >= self.cut[low] or f1 >= self.cut[far]:
                change = 0.0
        begin = self.lattice.point(low[0], low[1], low[2])
        length = self.lattice.point(far[0], far[1], far[2]) - begin
        return begin + t * length, change * length
