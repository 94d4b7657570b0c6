"""Volume control: shifts iso so that the mesh encloses the volume of the particles.

The half-coverage surface does not conserve volume: gaps of less than a spacing are filled (up to 4
% too much in a splash), and particles of a surface at rest are closer than in a lattice (0.07 to
0.1 spacings too low). So f is shifted by one Newton step, or two if the first one is large,

    shift = (V - V of all particles) / (dV/df),

which moves all surfaces by the same distance, 0.1 spacings in most scenes. V is the volume of the
mesh that marching cubes would make: with corners x on cell edges,

    V = sum over triangles a . (b x c)/6,
    dV/df = sum over triangles (b - a) x (c - a)/2 . (dx_a + dx_b + dx_c)/(3 df).

Volume control of level sets: Kim et al. 2007.
"""

import taichi as ti

from msph.launches import data_oriented, heavy_kernel
from msph.surface.device_lattice import WORD
from msph.surface.marching_cubes import MarchingCubes
from msph.surface.signs import lowest_bit
from msph.surface.thin_water import ThinWater

vec3 = ti.math.vec3

# Largest shift (-), 0.45 spacings inwards at 1.6 supports: weakly compressible water expands as
# much at its start. A sheet one particle thick does not vanish.
MAX_SHIFT = 0.14
# Smallest shift (-), 0.45 spacings outwards; larger with bodies, next to which half
# coverage is up to 0.34 spacings too low (`bowl`).
MIN_SHIFT, MIN_SHIFT_AT_BODIES = -0.14, -0.25
# Shift (-) from which a second Newton step is made: one step of 0.08 leaves up to 0.6 % of the
# volume.
SECOND_STEP = 0.02
# Smallest dV/df [m^3], in volumes of the water, against division by zero.
MIN_DERIVATIVE = 1e-6


@data_oriented
class WaterVolume:
    """Volume control. enclosed, derivative [m^3]: V, dV/df; shift (-): iso of marching cubes."""

    def __init__(self, cubes: MarchingCubes, thin: ThinWater):
        self.cubes, self.thin = cubes, thin
        self.lattice, self.numbers = cubes.lattice, cubes.numbers
        self.enclosed, self.derivative = ti.field(ti.f32, shape=()), ti.field(ti.f32, shape=())
        self.shift = cubes.iso

    def correct(self) -> None:
        """Shifts iso. The second call makes a step only if the first one was large."""
        self.make_step(0)
        self.make_step(1)

    def limit_reached(self) -> str | None:
        """Returns a message if the last shift reached its limit, otherwise None."""
        shift = self.shift[None]
        if shift <= self.numbers.min_shift[None]:
            return "the outward shift of the surface that conserves volume exceeds its limit"
        if shift >= self.numbers.max_shift[None]:
            return "the inward shift of the surface that conserves volume exceeds its limit"
        return None

    @heavy_kernel
    def make_step(self, again: ti.i32):
        """Makes one Newton step. again: 1 for the second step."""
        words = self.cubes.signs.word_count()
        if again == 0:
            self.shift[None] = 0.0
        elif abs(self.shift[None]) < SECOND_STEP:
            words = 0
        self.enclosed[None], self.derivative[None] = 0.0, 0.0
        for q in range(words):
            self.cubes.find_word(q)
        for q in range(ti.min(words, self.cubes.cell_words())):
            i, j, w = self.cubes.cell_position(q)
            low, high = self.cubes.corners(i, j, w)
            rest = self.cubes.cells(low, high, w)
            volume, change = 0.0, 0.0
            while rest != 0:
                k = lowest_bit(rest)
                rest &= rest - ti.u32(1)
                case = self.cubes.case(low, high, k)
                for t in range(self.cubes.cases.count[case, 0]):
                    part = self.triangle(ti.Vector([i, j, WORD * w + k]), case, t)
                    volume += part[0]
                    change += part[1]
            if volume != 0.0:
                self.enclosed[None] += volume
                self.derivative[None] += change
        if words > 0:
            water, before = self.thin.volume[None], self.shift[None]
            slope = ti.max(self.derivative[None], MIN_DERIVATIVE * water)
            least, most = self.numbers.min_shift[None], self.numbers.max_shift[None]
            # If all water is drops, there is nothing to shift.
            step = ti.select(water > 0.0, (self.enclosed[None] - water) / slope, 0.0)
            self.shift[None] = ti.math.clamp(before + step, least, most)

    @ti.func
    def triangle(self, cell, case, t):
        """Computes the contributions of a cell's t-th triangle to V and dV/df [m^3]."""
        # Column m is corner m. A runtime loop compiles corner() once instead of three times.
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
        """Computes the position [m] of the vertex on a cell's edge, and its derivative by f [m]."""
        low, axis = self.cubes.edge(cell, code)
        far = low
        for a in ti.static(range(3)):
            far[a] += ti.cast(axis == a, ti.i32)
        f0, f1 = self.cubes.level(low), self.cubes.level(far)
        a, b = self.lattice.node_index(low), self.lattice.node_index(far)
        begin = self.lattice.point(low)
        length = self.lattice.point(far) - begin
        t, slope = self.cubes.root(f0, f1, a, b, length)
        change = -1.0 / slope
        if self.cubes.at_wall(low, far):
            t, change = 0.5, 0.0
        if self.cubes.is_cut(a) or self.cubes.is_cut(b):
            change = 0.0
        return begin + t * length, change * length
