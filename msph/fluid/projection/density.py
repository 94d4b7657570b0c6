"""Density, its gradient and the diagonal of the pressure solves, in one pass over the neighbours.

The kernel is the quartic B-spline M5: its sums change little when an arrangement of particles is
strained at constant volume, so particles under pressure resist shear little.

Three corrections (docs/method.md, "Density"):
- Yield: an expansion lowers the kernel sum by slightly less than the density. W_ij is divided by
  the ratio of the two, and the particle's own part, which is constant, is lowered to match.
- Defect: with c = 1 at every particle, moving water is still 2 to 6 % too thin, since each particle
  sits at the peak of its own kernel. A second kernel, the bell (1 - q^2)^4, which enters no force,
  measures this: the density defect is its sum less c. The mean defect around a particle, followed
  slowly, is the density correction, which is added to c.
- Air share: the sums of particles at a free surface lack the share of the kernel that lies in the
  air. Without this correction the topmost sheet of particles is compressed until c = 1, to 1.45
  times the particles of a sheet inside, which resist every change of the surface's area.
"""

import math

import numpy as np
import taichi as ti

from msph.fluid.boundary.wall_integrals import wendland_behind
from msph.fluid.part import Part, Parts
from msph.fluid.particles import kernels
from msph.fluid.particles.layers import LayerSpec, pair_support, stress_share
from msph.fluid.particles.particles import Attribute
from msph.fluid.projection.mean_stress import (
    MeanStress,
    add_moment,
    add_stress,
    fade_out,
    relief_of,
)
from msph.launches import data_oriented, heavy_kernel, kernel
from msph.taichi_internals import on_cpu

ATTRIBUTES = (
    Attribute("density", "kg/m^3", "relative density c times rest density", view="density_error"),
    Attribute("known_volume", "m^3", "volume where the defect is known, or 0", carried=False),
    Attribute("known_defect", "m^3", "known_volume times density defect", carried=False),
    Attribute("density_correction", "-", "mean defect around a particle, at most 0"),
    Attribute("air_share", "-", "share of the kernel in the air above a surface", carried=False),
    Attribute("gradient", "1/m", "sum V_j grad W_ij, images included", width=3, carried=False),
    Attribute("diagonal", "1/m^2", "diagonal of the pressure solves' operator", carried=False),
    Attribute("pair_spacing", "m", "of equal particles that are held as stiffly", carried=False),
)

# Least distance [m] of two particles: keeps directions finite.
MIN_DISTANCE = 1e-8
# Relative density above which a particle is surrounded by water: no free surface or body is near.
SURROUNDED = 0.997
# Yields -1/3 sum V_j r_ij.grad W_ij on lattices (-), by support over spacing.
SMOOTHINGS = (2.4, 2.45, 2.5, 2.6, 2.8, 3.0)
YIELDS = (0.9964, 0.9962, 0.9970, 0.9980, 1.0016, 1.0011)
# Defect of evenly spread particles at rest, and limit of the correction (-); honey would need 0.07.
REST_DEFECT, MAX_CORRECTION = 0.003, 0.06
# Share (-) of a step's reading in the correction, which alternates with 1. Largest change in a step
# (-): after a larger change, surrounded particles would count as particles at a surface.
BLEND, MAX_CORRECTION_CHANGE = 0.25, 1.0 - SURROUNDED
# |sum V_j grad W_ij| over its value at a plane surface (-): no air share up to INSIDE, the whole
# from AT_SURFACE. Next to a hole of one particle, which must be able to close, it is 0.38.
INSIDE, AT_SURFACE = 0.6, 0.9
# Relative difference (-) of pair_spacing from spacing above which the air share fades out, to none
# at twice this. Without this limit a coarse sheet on fine particles gains energy.
MAX_SPACING_DIFFERENCE = 0.05
# Least divisor of the mean defect, in the particle's own volume (-).
MIN_VOLUME_SHARE = 1e-3
# Entries whose gradients are computed together: the largest vector that Taichi compiles well.
# On a GPU, whose threads keep so many numbers in slow memory, they are computed one by one.
BLOCK = 32
# Weight (-) of the particle itself in pair_spacing(): matters only without neighbours.
SELF_WEIGHT = 1e-3

# Sums over the neighbours of one particle: c by the kernel and by the bell (-), sum V_j grad W_ij
# and its part by the particle's own images [1/m], sum V_j |grad W_ij|^2 [1/m^5], sum V_j/h_ij^3 (-)
# and sum V_j/h_ij^5 [1/m^2], the last two times the bell's factor.
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
class Density(Part):
    """Relative density c (-), and the sums that the pressure solves need.

    pair_gradient (entries,) vec3 [1/m]: V_j grad W_ij of each entry of the neighbour list. With it
    the solves are a third faster than with slopes and positions. largest_excess: largest c - 1 (-).
    """

    def __init__(self, parts: Parts):
        super().__init__(parts)
        self.block = BLOCK if on_cpu() else 1
        self.with_stress = False  # True if shear relief is on
        self.summed_search = 0  # the neighbour search that the sums belong to
        self.largest_excess = 0.0
        self.pair_gradient = ti.Vector.field(
            3, ti.f32, shape=parts.neighbours.index.shape, layout=ti.Layout.SOA
        )

    def refresh(self) -> None:
        """Recomputes the sums if the list is new or bodies move; the list must be fresh."""
        if self.summed_search != self.neighbours.searches or self.boundary.moving:
            self.images.refresh()
            self.largest_excess = self._sum(self.particles.count, self.with_stress)
            if self.openings.all:
                self._fill_pipes(self.particles.count)
            self.summed_search = self.neighbours.searches

    @heavy_kernel
    def _sum(self, n: ti.i32, with_stress: ti.template()) -> ti.f32:
        """c_i = correction_i + own_i + sum V_j W_ij, the density defect, g_i = sum V_j grad W_ij,
        and D_i = |g_i|^2 + V_i sum V_j |grad W_ij|^2; with_stress: also the relief (mean_stress.py)
        by the stresses of the last step. Returns the largest c_i - 1. Own images add E to c_i and
        its gradient to g_i (kernels.own_image).

        Sums run over neighbours and images; a particle's own images move with it, twice as fast.
        """
        most = -1.0
        for i in range(n):
            layer = self.particles.layer[i]
            sums = Sums(c=self.layers.own[layer], bell=self.layers.own_bell[layer])
            mean = MeanStress()
            if ti.static(with_stress):
                own, p = self.layers.own_bell[layer], self.particles
                add_stress(mean, own, p.normal_stress[i], p.shear_stress[i])
            self._add_neighbours(i, sums, mean, with_stress)
            self._add_walls(i, sums, mean, with_stress)
            if ti.static(self.traits.bodies):
                self._add_bodies(i, sums, mean, with_stress)
            bodies = self.particles.body_share[i]
            g, volume = sums.gradient, self.layers.volume[layer]
            # c includes the correction, so that water compressed by the correction near a surface
            # does not count as surrounded.
            defect, c = sums.bell - sums.c, sums.c + self.particles.density_correction[i]
            known = ti.select(c > SURROUNDED, volume, 0.0)
            self.particles.known_volume[i], self.particles.known_defect[i] = known, known * defect
            self.particles.density[i] = (c + bodies) * self.constants.rest_density[None]
            ti.atomic_max(most, c + bodies - 1.0)
            self.particles.gradient[i] = g
            diagonal = (g + sums.own_images).norm_sqr() + volume * sums.squares
            self.particles.diagonal[i] = diagonal
            pair_spacing = self._pair_spacing(layer, sums)
            self.particles.pair_spacing[i] = pair_spacing
            if ti.static(with_stress):
                difference = ti.abs(pair_spacing / self.layers.spacing[layer] - 1.0)
                self.particles.relief[i] = relief_of(mean, difference)
            self.particles.air_share[i] = self._air_share(layer, g.norm(), pair_spacing)
        return most

    @kernel
    def _fill_pipes(self, n: ti.i32):
        """Raises the density of particles in inflows, at most to rest density, as if pipe and wall
        filled the kernel's share behind the cross-section. These particles have no air share.

        Otherwise gaps to the wall would have to close before the particles push, and a pipe a few
        particles wide would not push at all.
        """
        p = self.particles
        for i in range(n):
            if p.prescribed[i] > 0:
                p.air_share[i] = 0.0
                layer, x, opening = p.layer[i], p.x[i], p.prescribed[i] - 1
                behind = self.layers.own[layer]
                for s in range(self.neighbours.start[i], self.neighbours.end[i]):
                    j = self.neighbours.index[s]
                    if self.apertures.along(opening, p.x[j]) < 0.0:
                        behind += self.weight(layer, p.layer[j], (x - p.x[j]).norm())
                along, h = self.apertures.along(opening, x), self.layers.wall_support[layer]
                missing = ti.min(wendland_behind(along, h) - behind, 1.0 - self.relative(i))
                p.density[i] += ti.max(missing, 0.0) * self.constants.rest_density[None]

    @ti.func
    def _pair_spacing(self, layer, sums):
        """Returns the spacing [m] of equal particles that pressure would hold as stiffly.

        Pairs pull by sum V_j (p_i + p_j)/rho0 W''_ij, where W'' scales as 1/h_ij^5, so the mean of
        1/h_ij^2 weighted by V_j/h_ij^3 determines it. With its own spacing instead, a single fine
        particle among coarse particles would halve all time steps.
        """
        own = self.layers.per_h[layer, layer]
        share = SELF_WEIGHT * self.layers.bell_scale[layer, layer]
        held = (sums.stiffness + share * own**2) / (sums.shares + share)
        return self.layers.spacing[layer] * own / ti.sqrt(held)

    @ti.func
    def _air_share(self, layer, slope, pair_spacing):
        """Returns the air share (-) of a particle with the slope |sum V_j grad W_ij| [1/m]: the
        share at a plane surface, and 0 where the slope is small, as inside, in sheets one particle
        thick, and for single and paired particles."""
        ratio = slope / self.layers.surface_slope[layer]
        full = ti.math.clamp((ratio - INSIDE) / (AT_SURFACE - INSIDE), 0.0, 1.0)
        difference = ti.abs(pair_spacing / self.layers.spacing[layer] - 1.0)
        full *= fade_out(MAX_SPACING_DIFFERENCE, difference)
        return self.constants.air[None] * full * self.layers.surface_share[layer]

    @ti.func
    def _add_entry(self, layer, other, r_ij, sums: ti.template()):
        """Adds a particle of the layer `other` at -r_ij [m] to the sums of a particle of a layer,
        except to the gradient; returns V_j grad W_ij [1/m] and V_j times the bell (-)."""
        per_h, scale = self.layers.per_h[layer, other], self.layers.scale[layer, other]
        r2 = ti.max(r_ij.norm_sqr(), MIN_DISTANCE**2)
        per_r = ti.rsqrt(r2)
        # kernels.quartic_shape inlined, which saves a division.
        q = r2 * per_r * per_h
        a, b, c = ti.max(1.0 - q, 0.0), ti.max(0.6 - q, 0.0), ti.max(0.2 - q, 0.0)
        a3, b3, c3 = a * a * a, b * b * b, c * c * c
        slope = -4.0 * scale * per_h * per_r * (a3 - 5.0 * b3 + 10.0 * c3)
        sums.c += scale * (a3 * a - 5.0 * b3 * b + 10.0 * c3 * c)
        share, u = self.layers.bell_scale[layer, other], ti.max(1.0 - q * q, 0.0)
        bell = share * (u * u) * (u * u)
        sums.bell += bell
        sums.shares += share
        sums.stiffness += share * per_h * per_h
        return slope * r_ij, bell

    @ti.func
    def _add_neighbours(
        self, i, sums: ti.template(), mean: ti.template(), with_stress: ti.template()
    ):
        """Adds the neighbours of particle i to its sums and stores their gradients.

        Entries are read in blocks, since a store in the loop would stop the compiler from handling
        eight entries at a time, which is twice as fast.
        """
        p, layer, x = self.particles, self.particles.layer[i], self.particles.x[i]
        begin, end, size = self.neighbours.start[i], self.neighbours.end[i], self.block
        for block in range((end - begin + size - 1) // size):
            first = begin + size * block
            g_x, g_y = ti.Vector([0.0] * self.block), ti.Vector([0.0] * self.block)
            g_z = ti.Vector([0.0] * self.block)
            count = ti.min(size, end - first)
            for k in range(count):
                j = self.neighbours.index[first + k]
                r_ij, other = x - p.x[j], p.layer[j]
                g, bell = self._add_entry(layer, other, r_ij, sums)
                g_x[k], g_y[k], g_z[k] = g.x, g.y, g.z
                sums.gradient += g
                sums.squares += g.norm_sqr() * self.layers.per_volume[other]
                if ti.static(with_stress):
                    add_stress(mean, bell, p.normal_stress[j], p.shear_stress[j])
                    add_moment(mean, r_ij, g)
            for k in range(count):
                self.pair_gradient[first + k] = ti.math.vec3(g_x[k], g_y[k], g_z[k])

    @ti.func
    def _add_walls(self, i, sums: ti.template(), mean: ti.template(), with_stress: ti.template()):
        """Adds the images in walls to the sums, and stores their gradients and reactions."""
        layer, images = self.particles.layer[i], self.images
        per_spacing = 1.0 / self.layers.spacing[layer]
        for s in range(self.particles.first_image[i], self.particles.body_image[i]):
            j, r_ij = images.index[s], images.arm[s]
            g, bell = self._add_entry(layer, self.particles.layer[j], r_ij, sums)
            own, r = ti.select(j == i, 1.0, 0.0), ti.max(r_ij.norm(), MIN_DISTANCE)
            repulsion = own * kernels.own_image(r * per_spacing)
            g += repulsion.y * per_spacing / r * r_ij
            sums.c += repulsion.x
            sums.bell += repulsion.x  # a wall is not a defect of the density
            images.gradient[s], images.reaction[s] = g, -images.signs(s) * g
            self._add_image(i, s, bell, sums, mean, with_stress)

    @ti.func
    def _add_bodies(self, i, sums: ti.template(), mean: ti.template(), with_stress: ti.template()):
        """Adds the images in bodies to the sums."""
        layer, images = self.particles.layer[i], self.images
        for s in range(self.particles.body_image[i], self.particles.image_end[i]):
            other, bell = self.particles.layer[images.index[s]], 0.0
            if ti.static(with_stress):
                q2 = images.arm[s].norm_sqr() * self.layers.per_h[layer, other] ** 2
                u2 = ti.max(1.0 - q2, 0.0) ** 2
                bell = images.factor(s) * self.layers.bell_scale[layer, other] * u2 * u2
            self._add_image(i, s, bell, sums, mean, with_stress)

    @ti.func
    def _add_image(
        self, i, s, bell, sums: ti.template(), mean: ti.template(), with_stress: ti.template()
    ):
        """Adds the gradient, reaction and stress of image s, of the weight `bell` (-)."""
        p, images, j = self.particles, self.images, self.images.index[s]
        g, back = images.gradient[s], images.reaction[s]
        sums.gradient += g
        sums.squares += back.norm_sqr() * self.layers.per_volume[p.layer[j]]
        sums.own_images += ti.select(j == i, 1.0, 0.0) * g
        if ti.static(with_stress):
            normal, shear = images.mirrored_stress(s, p.normal_stress[j], p.shear_stress[j])
            add_stress(mean, bell, normal, shear)
            add_moment(mean, images.arm[s], g)

    @ti.func
    def weight(self, layer, other, r):
        """Returns V_j W_ij (-) of particles of two layers at the distance r [m], as in c."""
        shape = kernels.quartic_shape(r * self.layers.per_h[layer, other]).x
        return self.layers.scale[layer, other] * shape

    @ti.func
    def relative(self, i):
        """Returns c_i (-) for the positions of the last refresh()."""
        return self.particles.density[i] / self.constants.rest_density[None]

    @ti.func
    def excess(self, i):
        """Returns c_i - 1 (-), where a deficit is lowered by the air share, at most to 0."""
        excess = self.relative(i) - 1.0
        return ti.max(excess, ti.min(excess + self.particles.air_share[i], 0.0))

    @kernel
    def follow_defect(self, n: ti.i32):
        """Moves each density correction by BLEND towards the mean defect around its particle.

        The density changes in the same step: a step later, the water would be too thin by the
        change, below SURROUNDED, where no defect is known.
        """
        for i in range(n):
            target = ti.math.clamp(self._mean_defect(i) + REST_DEFECT, -MAX_CORRECTION, 0.0)
            change = BLEND * (target - self.particles.density_correction[i])
            change = ti.math.clamp(change, -MAX_CORRECTION_CHANGE, MAX_CORRECTION_CHANGE)
            self.particles.density_correction[i] += change
            self.particles.density[i] += change * self.constants.rest_density[None]

    @ti.func
    def _mean_defect(self, i):
        """Returns the mean density defect (-) of particle i and its neighbours, where known.

        Weighted by volume: between layers the defects of coarse and fine particles cancel.
        """
        total, known = self.particles.known_defect[i], self.particles.known_volume[i]
        for s in range(self.neighbours.start[i], self.neighbours.end[i]):
            j = self.neighbours.index[s]
            total += self.particles.known_defect[j]
            known += self.particles.known_volume[j]
        own = self.layers.volume[self.particles.layer[i]]
        return total / ti.max(known, MIN_VOLUME_SHARE * own)


def density_tables(
    specs: list[LayerSpec],
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Returns the density's columns of the tables by layer and by pair of layers."""
    smoothing, support, volume = (
        np.array([getattr(s, name) for s in specs]) for name in ("smoothing", "support", "volume")
    )
    per_yield = 1.0 / np.interp(smoothing, SMOOTHINGS, YIELDS)
    # V_j W_ij (-) is a kernel's shape times its factor times this.
    shares = volume * pair_support(support[:, None], support) ** -3.0
    peak = kernels.QUARTIC * kernels.QUARTIC_PEAK / smoothing**3
    missing, slope = np.transpose([lattice_surface(s) for s in smoothing])
    rows = {
        "surface_share": missing * per_yield,
        "surface_slope": slope * per_yield * smoothing / support,
        "per_volume": 1.0 / volume,
        "own": 1.0 - per_yield * (1.0 - peak),
        "own_bell": kernels.BELL / smoothing**3,
    }
    pairs = {
        "scale": kernels.QUARTIC * np.sqrt(per_yield[:, None] * per_yield) * shares,
        "bell_scale": kernels.BELL * shares,
        "stress_share": stress_share(support),
    }
    return rows, pairs


def lattice_surface(smoothing: float) -> tuple[float, float]:
    """Returns the deficit of a kernel of support `smoothing` [spacings] at the surface of a cubic
    lattice: 1 - c (-), and |sum V_j grad W_ij| [1/spacing]."""
    reach = math.ceil(smoothing)
    x = np.stack(np.meshgrid(*3 * [np.arange(-reach, reach + 1.0)]), axis=-1).reshape(-1, 3)
    above = x[x[:, 1] > 0.0]  # neighbours that the surface's sheet lacks
    r = np.linalg.norm(above, axis=1)
    q = r / smoothing
    a, b, c = (np.maximum(edge - q, 0.0) for edge in (1.0, 0.6, 0.2))
    shape, slope = a**4 - 5.0 * b**4 + 10.0 * c**4, 4.0 * (a**3 - 5.0 * b**3 + 10.0 * c**3)
    per_volume = kernels.QUARTIC / smoothing**3
    return per_volume * shape.sum(), per_volume / smoothing * (slope * above[:, 1] / r).sum()
