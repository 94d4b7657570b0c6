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

from msph.surface.device_lattice import WORD
from msph.surface.marching_cubes import MarchingCubes
from msph.surface.signs import lowest
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
    """enclosed and change [m^3]: V and dV/df; shift (-): the iso of marching cubes."""

    def __init__(self, cubes: MarchingCubes, thin: ThinWater):
        self.cubes, self.thin = cubes, thin
        self.lattice, self.numbers = cubes.lattice, cubes.numbers
        self.enclosed, self.change = ti.field(ti.f32, shape=()), ti.field(ti.f32, shape=())
        self.shift = cubes.iso

    def set_right(self) -> None:
        """Shifts f; where bodies cut, they go on to."""
        self.approach(0)
        self.approach(1)

    def limited(self) -> str | None:
        """Why the last mesh may not hold the water's volume, in words; None where the shift was
        free."""
        shift = self.shift[None]
        if shift <= self.numbers.least[None]:
            return "the surface would have to move outwards by more than it may"
        if shift >= self.numbers.most[None]:
            return "the surface would have to move inwards by more than it may"
        return None

    @kernel
    def approach(self, again: ti.i32):
        """One step; again: whether it is the second, which is made only after a far one."""
        words = self.cubes.signs.total()
        if again == 0:
            self.shift[None] = 0.0
        elif abs(self.shift[None]) < FAR:
            words = 0
        self.enclosed[None], self.change[None] = 0.0, 0.0
        for q in range(words):
            self.cubes.find_word(q)
        for q in range(ti.min(words, self.cubes.cell_words())):
            i, j, w = self.cubes.cell_place(q)
            low, high = self.cubes.corners(i, j, w)
            rest = self.cubes.cells(low, high, w)
            volume, change = 0.0, 0.0
            while rest != 0:
                k = lowest(rest)
                rest &= rest - ti.u32(1)
                case = self.cubes.case(low, high, k)
                for t in range(self.cubes.cases.count[case, 0]):
                    part = self.triangle(ti.Vector([i, j, WORD * w + k]), case, t)
                    volume += part[0]
                    change += part[1]
            if volume != 0.0:
                self.enclosed[None] += volume
                self.change[None] += change
        if words > 0:
            self.find_step()

    @ti.func
    def find_step(self):
        """Newton's step, as far as the shift stays within its bounds."""
        rest, before = self.thin.volume[None], self.shift[None]
        step = (self.enclosed[None] - rest) / ti.max(self.change[None], TINY * rest)
        least, most = self.numbers.least[None], self.numbers.most[None]
        self.shift[None] = ti.math.clamp(before + step, least, most)

    @ti.func
    def triangle(self, cell, case, t):
        """Parts of the t-th triangle of a cell in V and in dV/df [m^3]."""
        # Corner m is column m. In a loop, so that corner() is compiled once and not three times.
        corners, moved = ti.math.mat3(0.0), ti.math.vec3(0.0)
        for m in range(3):
            place, change = self.corner(cell, self.cubes.cases.edge[case, 3 * t + m])
            corners[0, m], corners[1, m], corners[2, m] = place
            moved += change
        a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
        volume = a.dot(b.cross(c)) / 6.0
        return ti.Vector([volume, (b - a).cross(c - a).dot(moved) / 6.0])

    @ti.func
    def corner(self, cell, code):
        """Place [m] of the vertex on an edge of a cell, and its derivative by f [m]."""
        low, axis = self.cubes.edge(cell, code)
        far = low
        for a in ti.static(range(3)):
            far[a] += ti.cast(axis == a, ti.i32)
        f0, f1 = self.cubes.level(low), self.cubes.level(far)
        t, change = f0 / (f0 - f1), 1.0 / (f0 - f1)
        if self.cubes.at_wall(low, far):
            t, change = 0.5, 0.0
        a, b = self.lattice.at(low), self.lattice.at(far)
        if f0 >= self.cubes.cut[a] or f1 >= self.cubes.cut[b]:
            change = 0.0
        begin = self.lattice.point(low)
        length = self.lattice.point(far) - begin
        return begin + t * length, change * length
