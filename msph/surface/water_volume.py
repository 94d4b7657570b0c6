"""Volume control: shifts iso so that the mesh encloses the volume of the particles.

The half-coverage surface does not conserve volume: gaps of less than a spacing are filled (up to 4
% too much in a splash), and particles of a surface at rest are closer than in a lattice (0.07 to
0.1 spacings too low). So f is shifted by one Newton step, or two if the first one is large,

    shift = (V - V of all particles) / (dV/df),

which moves all surfaces by the same distance, 0.1 spacings in most scenes. V is the volume of the
mesh of marching cubes: with corners x on cell edges,

    V = sum over triangles a . (b x c)/6,
    dV/df = sum over triangles (b - a) x (c - a)/2 . (dx_a + dx_b + dx_c)/(3 df).

Volume control of level sets: Kim et al. 2007.
"""

import taichi as ti

from msph.launches import data_oriented, kernel
from msph.surface.marching_cubes import MarchingCubes
from msph.surface.thin_water import ThinWater

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
    """Makes meshes that enclose the volume of the particles. shift (-): iso of marching cubes."""

    def __init__(self, cubes: MarchingCubes, thin: ThinWater):
        self.cubes, self.thin, self.numbers = cubes, thin, cubes.numbers
        self.shift = cubes.iso

    def make_mesh(self, overlap: float) -> None:
        """Makes a mesh that reaches into bodies by an overlap, in units of the cut (-), which is
        not part of its volume."""
        for steps in range(3):
            self.cubes.overlap[None] = overlap if steps == 2 else 0.0
            self.make_vertices(steps)
            self.cubes.make_triangles()
        self.cubes.overlap[None] = 0.0

    def limit_reached(self) -> str | None:
        """Returns a message if the last shift reached its limit, otherwise None."""
        shift = self.shift[None]
        if shift <= self.numbers.min_shift[None]:
            return "the outward shift of the surface that conserves volume exceeds its limit"
        if shift >= self.numbers.max_shift[None]:
            return "the inward shift of the surface that conserves volume exceeds its limit"
        return None

    @kernel
    def make_vertices(self, steps: ti.i32):
        """Makes a Newton step by the last mesh, if any, and the vertices after this number of
        steps: none after a small first step, which needs no second one."""
        if steps == 0:
            self.shift[None] = 0.0
        elif self.cubes.words[None] > 0:
            self.step()
        small = steps == 1 and abs(self.shift[None]) < SECOND_STEP
        self.cubes.words[None] = ti.select(small, 0, self.cubes.signs.word_count())
        self.cubes.place_vertices()

    @ti.func
    def step(self):
        """Makes a Newton step. Without all vertices the volume is not known; if all water is drops,
        there is nothing to shift."""
        water, mesh = self.thin.volume[None], self.cubes.mesh
        if mesh.counts[2] <= mesh.max_vertices and water > 0.0:
            slope = ti.max(self.cubes.slope[None], MIN_DERIVATIVE * water)
            shift = self.shift[None] + (self.cubes.volume[None] - water) / slope
            least, most = self.numbers.min_shift[None], self.numbers.max_shift[None]
            self.shift[None] = ti.math.clamp(shift, least, most)
