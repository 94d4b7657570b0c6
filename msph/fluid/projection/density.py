"""Density, its gradient and the diagonal of the pressure solves, by one pass over the neighbours.

The kernel is the quartic B-spline M5. Under pressure an arrangement resists shear by as much as
strain changes the kernel's sums; of regular lattices strained at constant volume M5 at 2.4 spacings
changes its sum by a tenth of Wendland C2's, M4's or Wendland C4's change.

Two corrections (docs/method.md, "Density"):
- Yield: expansion takes less off the kernel's sum than off the density. W_ij is divided by that
  share, and the particle's own part, which no motion changes, lowered by as much.
- Defect: c = 1 at every particle still leaves moving water 2 to 6 % too thin, since each particle
  sits in the peak of its own kernel. A second kernel, the bell (1 - q^2)^4, which no force obeys,
  sees it; bell minus c is the density defect. Its mean round a particle, followed slowly, is the
  density correction, which is added to c.
"""

import numpy as np
import taichi as ti

from msph.fluid.boundary.contact import Contact
from msph.fluid.constants import Constants
from msph.fluid.particles import kernels
from msph.fluid.particles.layers import Layers, LayerSpec, pair_support, stress_share
from msph.fluid.particles.neighbour_list import NeighbourList
from msph.fluid.particles.particles import Attribute, Particles
from msph.taichi_internals import data_oriented, kernel, on_cpu

ATTRIBUTES = (
    Attribute("density", "kg/m^3", "relative density c times rest density", view="density_error"),
    Attribute("known_volume", "m^3", "its own where its defect is known, else 0", carried=False),
    Attribute("known_defect", "m^3", "times density by the bell kernel less c", carried=False),
    Attribute("density_correction", "-", "mean defect round a particle, at most 0"),
    Attribute("gradient", "1/m", "sum V_j grad W_ij, images included", width=3, carried=False),
    Attribute("diagonal", "1/m^2", "diagonal of the pressure solves' operator", carried=False),
    Attribute("pair_spacing", "m", "of equals that pressure holds as stiffly", carried=False),
)

# Squared distance [m^2] from which on a direction can be told.
TINY = 1e-16
# Relative density from which on a particle is surrounded: no free surface or body is near.
SURROUNDED = 0.997
# -1/3 sum V_j r_ij.grad W_ij on lattices, by support over spacing: the share of an expansion that
# the kernel's sum sees. Beyond, the ends' values.
SMOOTHINGS = (2.4, 2.45, 2.5, 2.6, 2.8, 3.0)
YIELDS = (0.9964, 0.9962, 0.9970, 0.9980, 1.0016, 1.0011)
# Defect (-) that evenly spread particles at rest may have, and the largest correction (-); honey
# needs .07.
EVEN, MOST_CORRECTED = 0.003, 0.06
# Share of a step's reading in the correction: the whole would swing from step to step. And the most
# (-) that it changes in a step: more would take surrounded particles for a surface in the next.
BLEND, MOST_CHANGED = 0.25, 1.0 - SURROUNDED
# Least divisor of a mean, in a particle's own volume: keeps the mean over none finite.
SMALLEST = 1e-3
# Entries whose gradients are found together on a CPU: as many numbers as Taichi likes in a vector.
# On a GPU, whose threads would keep so many numbers in slow memory, they are found one by one.
BLOCK = 32

# Weight (-) of a particle as its own neighbour in pair_spacing(): decides only where it has none.
ALONE = 1e-3

# Sums over the neighbours of one particle: c and its value by the bell (-), sum V_j grad W_ij and
# its part by the particle's own images [1/m], sum V_j |grad W_ij|^2 [1/m^5], sum V_j/h_ij^3 (-) and
# sum V_j/h_ij^5 [1/m^2], both times the bell's factor.
Sums = ti.types.struct(
    c=ti.f32,
    bell=ti.f32,
    gradient=ti.math.vec3,
    own_images=ti.math.vec3,
    squares=ti.f32,
    shares=ti.f32,
    stiffness=ti.f32,
)


@data_oriented
class Density:
    """Relative density c (-) and what the pressure solves need beside it.

    pair_gradient (entries,) vec3 [1/m]: V_j grad W_ij of each entry of the neighbour list, a third
    faster for the solves than slopes and positions that they must gather. largest_excess is that of
    c - 1 over all particles (-).
    """

    def __init__(
        self,
        constants: Constants,
        contact: Contact,
        layers: Layers,
        particles: Particles,
        neighbours: NeighbourList,
    ):
        self.constants, self.contact = constants, contact
        self.layers, self.particles = layers, particles
        self.neighbours, self.images = neighbours, neighbours.images
        self.block = BLOCK if on_cpu() else 1
        self.summed = 0  # the search of the list over which the sums are
        self.largest_excess = 0.0
        self.pair_gradient = ti.Vector.field(
            3, ti.f32, shape=neighbours.index.shape, layout=ti.Layout.SOA
        )

    def refresh(self) -> None:
        """Sums anew if the list was searched anew, or where bodies move; the list must be fresh."""
        if self.summed != self.neighbours.searches or self.contact.boundary.moving:
            self.contact.refresh_shares()
            self.largest_excess = self._sum(self.particles.count)
            self.summed = self.neighbours.searches

    @kernel
    def _sum(self, n: ti.i32) -> ti.f32:
        """c_i = correction_i + own_i + sum V_j W_ij, the density defect, g_i = sum V_j grad W_ij,
        and D_i = |g_i|^2 + V_i sum V_j |grad W_ij|^2. Returns the largest c_i - 1.

        Sums over neighbours and images; a particle's own images move with it, twice as fast.
        """
        most = -1.0
        for i in range(n):
            layer = self.particles.layer[i]
            sums = Sums(c=self.layers.own[layer], bell=self.layers.own_bell[layer])
            sums.gradient = self.particles.boundary_gradient[i]
            bodies = self.particles.boundary_share[i]
            for mirrored in ti.static((False, True)):
                self._add_entries(i, mirrored, sums)
            g, volume = sums.gradient, self.layers.volume[layer]
            # The correction counts: else water that it compresses near a surface seems surrounded.
            defect, c = sums.bell - sums.c, sums.c + self.particles.density_correction[i]
            known = ti.select(c > SURROUNDED, volume, 0.0)
            self.particles.known_volume[i], self.particles.known_defect[i] = known, known * defect
            self.particles.density[i] = (c + bodies) * self.constants.rest_density[None]
            ti.atomic_max(most, c + bodies - 1.0)
            self.particles.gradient[i] = g
            diagonal = (g + sums.own_images).norm_sqr() + volume * sums.squares
            self.particles.diagonal[i] = diagonal
            self.particles.pair_spacing[i] = self.pair_spacing(layer, sums)
        return most

    @ti.func
    def pair_spacing(self, layer, sums):
        """Spacing [m] of equal particles among which pressure would hold one as stiffly in place.

        It pulls by sum V_j (p_i + p_j)/rho0 W''_ij, W'' as 1/h_ij^5: so it is the mean of 1/h_ij^2,
        weighed by V_j/h_ij^3. By its own spacing a single fine particle that waves had drawn down
        among coarse ones halved all steps of a pool.
        """
        own, share = self.layers.per_h[layer, layer], ALONE * self.layers.bell_scale[layer, layer]
        held = (sums.stiffness + share * own**2) / (sums.shares + share)
        return self.layers.spacing[layer] * own / ti.sqrt(held)

    @ti.func
    def _add_entries(self, i, mirrored: ti.template(), sums: ti.template()):
        """Adds the neighbours of particle i, or with `mirrored` the images, to its sums, and stores
        their gradients.

        Stored block by block: a store might change what the next entry reads, for all that the
        compiler knows; without one in the loop it meets eight entries at a time, twice as fast.
        """
        layer, x = self.particles.layer[i], self.particles.x[i]
        begin, end = self.neighbours.span(i, mirrored)
        size = self.block
        for block in range((end - begin + size - 1) // size):
            first = begin + size * block
            g_x, g_y = ti.Vector([0.0] * self.block), ti.Vector([0.0] * self.block)
            g_z = ti.Vector([0.0] * self.block)
            count = ti.min(size, end - first)
            for k in range(count):
                j, mirror, wall = self.neighbours.read(first + k, mirrored)
                other = self.particles.layer[j]
                per_h, scale = self.layers.per_h[layer, other], self.layers.scale[layer, other]
                r_ij = self.images.offset(x, self.particles.x[j], mirror, wall)
                r2 = ti.max(r_ij.norm_sqr(), TINY)
                per_r = ti.rsqrt(r2)
                # kernels.quartic_shape written out: a division less.
                q = r2 * per_r * per_h
                a, b, c = ti.max(1.0 - q, 0.0), ti.max(0.6 - q, 0.0), ti.max(0.2 - q, 0.0)
                a3, b3, c3 = a * a * a, b * b * b, c * c * c
                slope = -4.0 * scale * per_h * per_r * (a3 - 5.0 * b3 + 10.0 * c3)
                g = slope * r_ij
                g_x[k], g_y[k], g_z[k] = g.x, g.y, g.z
                sums.c += scale * (a3 * a - 5.0 * b3 * b + 10.0 * c3 * c)
                u = ti.max(1.0 - q * q, 0.0)
                share = self.layers.bell_scale[layer, other]
                sums.bell += share * (u * u) * (u * u)
                sums.gradient += g
                sums.squares += g.norm_sqr() * self.layers.per_volume[other]
                if ti.static(mirrored):
                    sums.own_images += ti.select(j == i, 1.0, 0.0) * g
                sums.shares += share
                sums.stiffness += share * per_h * per_h
            for k in range(count):
                self.pair_gradient[first + k] = ti.math.vec3(g_x[k], g_y[k], g_z[k])

    @ti.func
    def weight(self, layer, other, r):
        """V_j W_ij (-) of two layers' particles at the distance r [m], as in c."""
        shape = kernels.quartic_shape(r * self.layers.per_h[layer, other]).x
        return self.layers.scale[layer, other] * shape

    @ti.func
    def excess(self, i):
        """c_i - 1 (-), by the positions of the last refresh()."""
        return self.particles.density[i] / self.constants.rest_density[None] - 1.0

    @kernel
    def follow_defect(self, n: ti.i32):
        """Moves the density corrections by BLEND towards the mean defect round each particle, and
        the densities with them: the next step's water is at rest density under the new ones, not
        thinner by the change, which would blind the reading that they follow."""
        for i in range(n):
            target = ti.math.clamp(self.mean_defect(i) + EVEN, -MOST_CORRECTED, 0.0)
            change = BLEND * (target - self.particles.density_correction[i])
            change = ti.math.clamp(change, -MOST_CHANGED, MOST_CHANGED)
            self.particles.density_correction[i] += change
            self.particles.density[i] += change * self.constants.rest_density[None]

    @ti.func
    def mean_defect(self, i):
        """Mean density defect (-) of particle i and its neighbours, where it is known.

        Weighed by volume: between layers defects of coarse and of fine particles cancel.
        """
        total, known = self.particles.known_defect[i], self.particles.known_volume[i]
        for s in range(self.neighbours.start[i], self.neighbours.mirrors[i]):
            j = self.neighbours.index[s]
            total += self.particles.known_defect[j]
            known += self.particles.known_volume[j]
        own = self.layers.volume[self.particles.layer[i]]
        return total / ti.max(known, SMALLEST * own)


def density_tables(
    specs: list[LayerSpec],
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Columns of the density in the tables by layer and by pair of layers."""
    smoothing, support, volume = (
        np.array([getattr(s, name) for s in specs]) for name in ("smoothing", "support", "volume")
    )
    per_yield = 1.0 / np.interp(smoothing, SMOOTHINGS, YIELDS)
    # Factors that turn the kernels' shapes into V_j W_ij (-).
    shares = volume * pair_support(support[:, None], support) ** -3.0
    peak = kernels.QUARTIC * kernels.QUARTIC_PEAK / smoothing**3
    rows = {
        "per_volume": 1.0 / volume,
        "per_yield": per_yield,
        "own": 1.0 - per_yield * (1.0 - peak),
        "own_bell": kernels.BELL / smoothing**3,
    }
    pairs = {
        "scale": kernels.QUARTIC * np.sqrt(per_yield[:, None] * per_yield) * shares,
        "bell_scale": kernels.BELL * shares,
        "stress_share": stress_share(support),
    }
    return rows, pairs
