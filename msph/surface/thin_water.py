"""Narrow, stretched kernels for thin water: sheets, threads and drops keep their volume, and sheets
and threads are smooth.

Wide kernels make flat surfaces smooth, but in a sheet of particles of spacing d the coverage is
only 315/256 d/r, which is half at r = 2.45 d; half of that in a thread, and a tenth for an isolated
particle: thin water would vanish. So a particle's kernel depends on the coverage c at its position,
computed with wide kernels. With c_sheet in a single sheet, c_flat = 1 - lambda(d/2r) in a flat
surface (fluid_fraction.py), and c_thick halfway between,

    r_j = SHEET_REACH d                       for c < c_sheet, rising to r at c_thick,
    w_j = 1 + (ISOLATED_WEIGHT - 1) t^2,  t = (c_sheet - c)/(c_sheet - c_isolated) if c < c_sheet,

t = 0 otherwise. Both are continuous in c. The kernel has this reach only across the water. With C
the covariance of the neighbours' places, weighted by wide kernels, its squared reaches are the
eigenvalues of

    G = r_j^2 I + (1 - t) (r^2 - r_j^2) X (I + X)^-1,   X = (C/(HALF_STRETCHED r^2))^2,

so nearly r along a sheet: particles merge into a film, whose thickness depends on the reach across
only. The kernel's centre moves by SMOOTHED (1 - t) towards the mean of the neighbours, up to
c_thick, which makes a film flat; r in G is less by this motion. Kernels stretched along the water,
at smoothed places: Yu and Turk (2013). A particle without neighbours is a drop: the drop has no
kernel, and a sphere is added to the mesh (drops.py). Meshes for images lack the share of each
particle that images show as spray (spray.py).
"""

import numpy as np
import taichi as ti

from msph.device_table import DeviceTable, f32
from msph.fluid.particles.layers import SPHERE_RADIUS, LayerSpec
from msph.launches import data_oriented
from msph.surface.bodies import Bodies
from msph.surface.fluid_fraction import POLY6, SLOPE, cut_share, missing
from msph.surface.relief import Relief
from msph.surface.room import LAYERS, SurfaceRoom
from msph.surface.spray import Spray

vec3 = ti.math.vec3

# Reach [spacings] of kernels in sheets and thinner water: coverage is half at d/2 from the sheet,
# 315/256 d/r (1 - (d/2r)^2)^4 = 1/2, so a sheet keeps its thickness.
SHEET_REACH = 1.75
# Weight (-) of an almost isolated particle, whose surface then encloses its volume. At 2, some
# particles vanish between the nodes of cells of 0.75 spacings.
ISOLATED_WEIGHT = 2.6
# Variance of the neighbours along an axis, over the squared full reach (-), at which the kernel is
# stretched half-way along it: a sheet has 1/10 along and 0 across, two sheets 1/36 across.
HALF_STRETCHED = 1.0 / 18.0
# Share of the way from a particle to the mean of its neighbours by which its kernel is moved in
# sheets and thinner water (Yu and Turk 2013).
SMOOTHED = 0.9
# Distance to the nearest neighbour beyond which a particle is a drop, in mean spacings of the two:
# the surfaces of two drops touch at 2.1.
DROP_GAP = 2.15
# Distance (mean spacings) and squared distance [m^2] to the neighbour of a particle without any.
NO_NEIGHBOUR = 1e9
# Least difference between kernels (-) by which is divided.
TINY = 1e-6


@ti.dataclass
class Around:
    """Sums over particles j near x [m], with e = x_j - x [m]: of the weights (1 - e^2/r^2)^3 (-);
    of weights times e, times its squares xx, yy, zz, and times its products yz, zx, xy. nearest2:
    the least e^2 [m^2] of particles that are not at x."""

    x: vec3
    per_r2: ti.f32
    total: ti.f32
    first: vec3
    squares: vec3
    products: vec3
    nearest2: ti.f32


@data_oriented
class ThinWater:
    """The kernel of every particle j: V w det(G)^(-1/2) poly6(sqrt(y.G^-1 y)), y = x - centre_j.

    by_layer: reach r [m]; isolated, sheet, thick (-): the coverages c_isolated, c_sheet and c_thick
    of the module docstring. kernel, by particle: 1/r_j^2 [1/m^2] and the kernel's value at its
    centre (-), 0 for a drop. Of particles in thin water, where r_j < r: centre [m]; squares and
    products [1/m^2]: the entries xx, yy, zz and yz, zx, xy of G^-1. kept, by particle: the share of
    its volume in the mesh (-). The first drop_count[None] entries of drops are the drops' indices.
    volume [m^3]: of all other particles in the box, as far as it is kept.
    """

    def __init__(self, layers, grid, particles, bodies: Bodies, room: SurfaceRoom):
        self.layers, self.grid, self.particles, self.bodies = layers, grid, particles, bodies
        self.numbers = bodies.numbers
        self.by_layer = DeviceTable((LAYERS,), reach=f32, isolated=f32, sheet=f32, thick=f32)
        self.spray = Spray(layers, particles, bodies.numbers, room)
        self.relief = Relief(layers, grid, particles, bodies.numbers, self.spray)
        self.kernel = ti.Vector.field(2, ti.f32, shape=room.particles)
        self.centre, self.squares, self.products = (
            ti.Vector.field(3, ti.f32, shape=room.particles) for _ in range(3)
        )
        self.kept = ti.field(ti.f32, shape=room.particles)
        self.drops = ti.field(ti.i32, shape=room.particles)
        self.drop_count, self.volume = ti.field(ti.i32, shape=()), ti.field(ti.f32, shape=())

    def load(self, specs: list[LayerSpec], radii: np.ndarray) -> None:
        """Loads a scene. radii (layers,): reach of each layer's kernel [m]."""
        d = np.array([s.spacing for s in specs]) / radii
        self.by_layer.fill(
            reach=radii,
            isolated=POLY6 * d**3,
            sheet=SLOPE * d,
            thick=0.5 * (SLOPE * d + 1.0 - missing(0.5 * d)),
        )

    @ti.func
    def clear(self):
        """Prepares set_kernel() of all particles."""
        self.volume[None], self.drop_count[None], self.spray.count[None] = 0.0, 0, 0

    @ti.func
    def full(self, layer):
        """Returns the kernel of a particle in deep water."""
        return ti.Vector([1.0 / self.by_layer.reach[layer] ** 2, self.by_layer.isolated[layer]])

    @ti.func
    def set_kernel(self, i, deep, bodies: ti.template(), frame, dt, image):
        """Sets the kernel of particle i (deep: known to be in deep water) and adds its volume, or
        lists it as a drop; a particle beyond a wall is neither added nor listed. frame, dt: of the
        spray; image: 1 if the mesh lacks spray. Returns the distance [m] within which the kernel
        exceeds the full kernel."""
        layer, x, size = self.particles.layer[i], self.particles.x[i], self.numbers.size[None]
        # Outside are the pipe of an opening, and a jet out of the box.
        inside = ti.min(x.x, x.y, x.z, size.x - x.x, size.z - x.z) >= 0.0
        self.kernel[i], larger, drop, kept = self.full(layer), 0.0, False, 1.0
        if not deep:
            c, nearest, _mean, _spread = self.neighbours(i, bodies, self.add_weights)
            drop = nearest > DROP_GAP
            # The images of a drop in walls are no neighbours that hold it together.
            loose = 1.0 if drop else self.looseness(c, layer)
            if ti.static(bodies):
                if drop:
                    radius = SPHERE_RADIUS * self.layers.spacing[layer]
                    drop = self.bodies.clearance(self.particles.x[i]) > radius
            if inside:
                kept -= image * self.spray.follow(i, loose, frame, dt)
            if drop:
                self.kernel[i][1] = 0.0
                if inside and kept > 0.0:
                    self.drops[ti.atomic_add(self.drop_count[None], 1)] = i
            elif c < self.by_layer.thick[layer]:
                larger = self.narrow(i, layer, bodies)
                self.kernel[i][1] *= kept
        self.kept[i] = kept
        if inside and not drop:
            self.volume[None] += kept * self.layers.volume[layer]
        return larger

    @ti.func
    def spacing(self, i):
        """Returns the spacing [m] of particle i: the edge of the cube of its volume."""
        return self.layers.spacing[self.particles.layer[i]]

    @ti.func
    def looseness(self, c, layer):
        """Returns t (-) of the module docstring for a coverage c (-): 0 in a sheet, 1 alone."""
        sheet, isolated = self.by_layer.sheet[layer], self.by_layer.isolated[layer]
        return ti.math.clamp((sheet - c) / (sheet - isolated), 0.0, 1.0)

    @ti.func
    def narrow(self, i, layer, bodies: ti.template()):
        """Sets the kernel of particle i in thin water; returns the distance [m] within which the
        kernel exceeds the full kernel."""
        c, _, mean, spread = self.neighbours(i, bodies, self.add_moments)
        sheet, thick = self.by_layer.sheet[layer], self.by_layer.thick[layer]
        full, least = self.by_layer.reach[layer], SHEET_REACH * self.layers.spacing[layer]
        isolated = self.by_layer.isolated[layer]
        whole, t = ti.max((c - sheet) / (thick - sheet), 0.0), self.looseness(c, layer)
        moved = SMOOTHED * (1.0 - whole) * (1.0 - t) * mean
        across2, full2 = ti.math.mix(least, full, whole) ** 2, full * full
        # The moved kernel stays within the full reach of the particle.
        along2 = ti.math.mix(ti.max((full - moved.norm()) ** 2, across2), across2, t)
        one, extent = ti.Matrix.identity(ti.f32, 3), spread / (HALF_STRETCHED * full2)
        extent = extent @ extent
        reach2 = across2 * one + (along2 - across2) * (extent @ (one + extent).inverse())
        weight = 1.0 + (ISOLATED_WEIGHT - 1.0) * t * t
        peak, inverse = weight * full**3 / ti.sqrt(reach2.determinant()), reach2.inverse()
        self.kernel[i] = ti.Vector([1.0 / across2, isolated * peak])
        self.centre[i] = self.particles.x[i] + moved
        self.squares[i] = vec3(inverse[0, 0], inverse[1, 1], inverse[2, 2])
        self.products[i] = vec3(inverse[1, 2], inverse[2, 0], inverse[0, 1])
        # peak (1 - x^2/r^2)^3 = (1 - x^2/full^2)^3 for the longest r.
        longest2 = ti.min(reach2.trace() - 2.0 * across2, along2)
        s = peak ** (1.0 / 3.0)
        falls = ti.max(s / longest2 - 1.0 / full2, TINY / full2)
        return ti.sqrt(ti.max(s - 1.0, 0.0) / falls) + moved.norm()

    @ti.func
    def neighbours(self, i, bodies: ti.template(), add: ti.template()):
        """Computes from the particles around particle i, with kernels of full reach: coverage (-),
        and by add_weights the distance to the nearest, over the mean of the two spacings, or by
        add_moments the mean [m] and the covariance [m^2] of the places relative to particle i.
        Walls and bodies hide neighbours: they have no part in the mean."""
        x, size, spacing = self.particles.x[i], self.numbers.size[None], self.spacing(i)
        c, nearest, total = 0.0, NO_NEIGHBOUR, 0.0
        mean, d, o = vec3(0.0), vec3(0.0), vec3(0.0)
        for layer in range(self.numbers.layers[None]):
            r, weight = self.by_layer.reach[layer], self.by_layer.isolated[layer]
            found = Around(x=x, per_r2=1.0 / (r * r), nearest2=NO_NEIGHBOUR)
            self.grid.for_each_row(x, layer, r, add, found)
            if found.total > 0.0:
                share = 1.0
                for axis in ti.static(range(3)):
                    low, high = cut_share(x[axis] / r), cut_share((size[axis] - x[axis]) / r)
                    share *= 1.0 - low
                    share *= 1.0 - high
                    found.first[axis] *= (1.0 - 2.0 * low) * (1.0 - 2.0 * high)
                if ti.static(bodies):
                    part = self.bodies.open_share(x, layer)[0]
                    share *= part
                    found.first *= ti.max(2.0 * part - 1.0, 0.0)
                c += weight * found.total / share
                total += weight * found.total
                mean += weight * found.first
                d += weight * found.squares
                o += weight * found.products
            between = 0.5 * (spacing + self.layers.spacing[layer])
            nearest = ti.min(nearest, ti.sqrt(found.nearest2) / between)
        # The particle itself adds to total.
        mean, d, o = mean / total, d / total, o / total
        second = ti.Matrix([[d.x, o.z, o.y], [o.z, d.y, o.x], [o.y, o.x, d.z]])
        return c, nearest, mean, second - mean.outer_product(mean)

    @ti.func
    def add_weights(self, begin, end, found: ti.template()):
        for j in range(begin, end):
            e2 = (self.particles.x[j] - found.x).norm_sqr()
            u = ti.max(1.0 - e2 * found.per_r2, 0.0)
            found.total += u * u * u
            if e2 > 0.0:
                found.nearest2 = ti.min(found.nearest2, e2)

    @ti.func
    def add_moments(self, begin, end, found: ti.template()):
        for j in range(begin, end):
            e = self.particles.x[j] - found.x
            u = ti.max(1.0 - e.norm_sqr() * found.per_r2, 0.0)
            w = u * u * u
            found.total += w
            found.first += w * e
            found.squares += w * e * e
            found.products += w * e.yzx * e.zxy
