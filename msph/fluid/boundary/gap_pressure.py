"""Pressure on bodies in gaps in which no particles fit.

Where a wall or another body is nearer than about a spacing, no particles fit, and those at the rim
press too little on the faces. There the pressure is extrapolated to samples of the face from the
water around (Adami et al. 2012, Band et al. 2018): the mean of the particles' pressures, raised by
the hydrostatic pressure between particle and sample, and where no particle is within reach, the
mean over the nearest samples of the same body. This pressure replaces forces of particles there:
their contact impulses (gaps.py), and the pressure of their links at a sample s,
P(s) = sum V_i p_i W(s - x_i) G.n/(n.grad lambda) with their multipliers p_i: W is the part of s in
grad lambda (Gauss), and G differs, since images press as well. The opposite acts on the floating
body on the other side. Pressures and impulses are those of the last step.
"""

import numpy as np
import taichi as ti

from msph.fluid.boundary.body_faces import samples
from msph.fluid.boundary.body_links import BodyLinks
from msph.fluid.boundary.body_shapes import BEGIN
from msph.fluid.boundary.contact import Contact
from msph.fluid.boundary.gaps import WIDE
from msph.fluid.external_forces import FIELD_NUMBERS, NO_HAND, ExternalForces, field_at
from msph.fluid.particles.grid import LayeredGrid
from msph.fluid.particles.kernels import WENDLAND
from msph.fluid.particles.mirror_images import MirrorImages
from msph.fluid.room import MAX_BODIES
from msph.fluid.small_numbers import MIN_DIVISOR
from msph.taichi_internals import data_oriented, heavy_kernel, kernel

vec3, vec4 = ti.math.vec3, ti.math.vec4

# Largest edge of a sample, in finest spacings, and largest number of samples of a body.
EDGE, MAX_SAMPLES = 1.2, 2000
# Depth [finest spacings] in a wall or another body at which a sample has no water in front of it.
INSIDE = 0.5
# Contribution of bodies and their images to c (-) of a particle wedged between two faces: its
# pressure is up to 1.3 times the water's around, and counts less the larger the contribution is.
WEDGED = 0.5
# Least share (-) of the kernel that particles fill, wedged particles counting less, at a sample
# whose pressure is read from them.
LEAST_SHARE = 0.05
# Slope of lambda along a normal, times the support (-), above which it divides G; largest ratio of
# the two (-), 2 at a plane.
MIN_SLOPE, LARGEST_RATIO = 1e-3, 2.5

NUMBERS = ti.types.ndarray(dtype=ti.f32, ndim=2)
# Sums at a sample: the kernel's filled share (-), share times extrapolated pressure [Pa], and
# `resolved`, P [Pa]; `at` is the sample mirrored by `mirrors`, `normal` that of the body there.
Reading = ti.types.struct(
    **{"at": vec3, "sample": vec3, "gravity": vec3, "layer": ti.i32},
    **{"body": ti.i32, "mirrors": ti.i32, "normal": vec3},
    **{"share": ti.f32, "pressure": ti.f32, "resolved": ti.f32},
)


@data_oriented
class GapPressure:
    """Samples of all bodies' faces in their frames: points [m] and area vectors [m^2]; by sample in
    a gap: sample, other body (WALL for a wall), weight (-), filled share (-), pressure and
    resolved, P [Pa]."""

    def __init__(self, links: BodyLinks, grid: LayeredGrid, contact: Contact):
        boundary = contact.boundary
        self.boundary, self.contact, self.grid, self.links = boundary, contact, grid, links
        self.constants, self.layers, self.gaps = boundary.constants, boundary.layers, contact.gaps
        self.particles, self.impulses = contact.particles, contact.impulses
        self.images = MirrorImages(boundary.constants)
        capacity = MAX_BODIES * MAX_SAMPLES
        self.owner, self.sample, self.other = (ti.field(ti.i32, shape=capacity) for _ in range(3))
        self.point, self.area = (ti.Vector.field(3, ti.f32, shape=capacity) for _ in range(2))
        self.weight, self.share, self.pressure, self.resolved = (
            ti.field(ti.f32, shape=capacity) for _ in range(4)
        )
        self.found = ti.field(ti.i32, shape=())
        self.count, self.idle, self.last_step = 0, False, 1.0

    def load(self) -> None:
        """Takes the samples of the boundary's present bodies; compiles all kernels."""
        edge = EDGE * self.layers.finest.spacing
        clouds = [samples(body, edge, MAX_SAMPLES) for body in self.boundary.bodies]
        self.count, self.idle = sum(len(points) for points, _ in clouds), not clouds
        self.gaps.active[None] = 0
        self.gaps.clear()
        if clouds:
            owner = np.repeat(np.arange(len(clouds)), [len(points) for points, _ in clouds])
            points, areas = (np.concatenate(part) for part in zip(*clouds, strict=True))
            table = np.column_stack([points, areas]).astype(np.float32)
            self._store(table, owner.astype(np.int32))
            self._read(0, NO_HAND.field())
            self._push(0, 0.0, 0.0)

    @kernel
    def _store(self, table: NUMBERS, owner: ti.types.ndarray(dtype=ti.i32, ndim=1)):
        for k in range(table.shape[0]):
            self.point[k] = vec3(table[k, 0], table[k, 1], table[k, 2])
            self.area[k] = vec3(table[k, 3], table[k, 4], table[k, 5])
            self.owner[k] = owner[k]

    def push(self, dt: float, external: ExternalForces) -> bool:
        """Applies the missing pressure to the bodies for dt [s], at the poses at the beginning of
        the second half of the step; returns True if there are gaps. Grid and links must be
        fresh."""
        if self.idle:
            return False
        if not self.boundary.close_together(WIDE * self.layers.finest.spacing):
            self.gaps.active[None] = 0
            return False
        found = self._find_gaps(self.count)
        self.gaps.active[None] = int(found > 0)
        self.idle = not found and not self.boundary.moving
        if found:
            self._read(found, external.field())
            self._push(found, dt, dt / self.last_step)
            self.gaps.clear()
            self.contact.push_moving()
            self.boundary.redo(0.5 * dt)
        self.last_step = dt
        return found > 0

    @kernel
    def _find_gaps(self, count: ti.i32) -> ti.i32:
        """Finds the samples in gaps; returns their number."""
        self.found[None] = 0
        for k in range(count):
            b = self.owner[k]
            turn = self.boundary.rotation[b, BEGIN]
            x = self.boundary.centre[b, BEGIN] + turn @ self.point[k]
            normal = (turn @ self.area[k]).normalized(MIN_DIVISOR)
            weight, other = self.gaps.side(b, x, vec4(0.0, normal[0], normal[1], normal[2]), BEGIN)
            if weight > 0.0 and self._is_free(b, x):
                gap = ti.atomic_add(self.found[None], 1)
                self.sample[gap], self.other[gap], self.weight[gap] = k, other, weight
        return self.found[None]

    @ti.func
    def _is_free(self, b, x):
        """Returns False if x [m] is in a wall or in another body than b."""
        depth = INSIDE * self.constants.finest_spacing[None]
        walls = self.constants.walls[None]
        free = x.min() > -depth and (walls - x).min() > -depth
        for a in range(self.constants.bodies[None]):
            if a != b and self.boundary.reaches(a, x, 0.0, BEGIN):
                free = free and self.boundary.distance(a, x, BEGIN).x > -depth
        return free

    @ti.func
    def _place(self, gap):
        """Returns the position [m] of a sample in a gap."""
        k = self.sample[gap]
        b = self.owner[k]
        return self.boundary.centre[b, BEGIN] + self.boundary.rotation[b, BEGIN] @ self.point[k]

    @heavy_kernel
    def _read(self, found: ti.i32, field: FIELD_NUMBERS):
        """Sums pressures over the particles and images around the samples in gaps."""
        centre = 0.5 * self.constants.size[None]
        for gap in range(found):
            gravity = field_at(self._place(gap) - centre, field)
            x, k = self._place(gap), self.sample[gap]
            b = self.owner[k]
            normal = self.boundary.rotation[b, BEGIN] @ self.area[k].normalized(MIN_DIVISOR)
            reading = Reading(gravity=gravity, sample=x, body=b, normal=normal)
            for layer in range(self.constants.layers[None]):
                h = self.boundary.support[layer]
                near = self.images.walls_near(x, h)
                for number in range(self.images.combinations(near)):
                    mirrors = self.images.combination(number, near)
                    mirror, wall = self.images.mirror_and_wall(mirrors)
                    reading.mirrors = mirrors
                    reading.at, reading.layer = self.images.reflected(x, mirror, wall), layer
                    self.grid.for_each_row(reading.at, layer, h, self._add_row, reading)
            self.share[gap] = reading.share
            self.resolved[gap] = reading.resolved
            self.pressure[gap] = reading.pressure / ti.max(reading.share, LEAST_SHARE)

    @ti.func
    def _add_row(self, begin, end, reading: ti.template()):
        layer = reading.layer
        h = self.boundary.support[layer]
        for i in range(begin, end):
            x = self.particles.x[i]
            u = ti.max(1.0 - (reading.at - x).norm() / h, 0.0)
            share = self.layers.volume[layer] * WENDLAND / h**3 * u**4 * (5.0 - 4.0 * u)
            multiplier = self.layers.per_yield[layer] * self.particles.pressure_multiplier[i]
            own = ti.max(self.particles.pressure[i], 0.0)
            rise = self.constants.rest_density[None] * reading.gravity.dot(reading.sample - x)
            rise = ti.math.clamp(rise, -own, own)
            reading.resolved += share * (multiplier + rise) * self._by_link(i, reading)
            share *= ti.max(1.0 - self.particles.boundary_share[i] / WEDGED, 0.0)
            reading.share += share
            reading.pressure += share * (own + rise)

    @ti.func
    def _by_link(self, i, reading: ti.template()):
        """Returns the ratio (-) of G to grad lambda along the sample's normal; 1 without a link."""
        first, found = self.particles.first_link[i], 1.0
        for link in range(first, first + self.particles.links[i]):
            same = self.links.mirrors[link] == reading.mirrors
            if same and self.links.body[link] == reading.body:
                behind = self.links.share_gradient[link].dot(reading.normal)
                if behind < -MIN_SLOPE * self.layers.per_h[reading.layer, reading.layer]:
                    ratio = self.links.gradient[link].dot(reading.normal) / behind
                    found = ti.math.clamp(ratio, 0.0, LARGEST_RATIO)
        return found

    @kernel
    def _push(self, found: ti.i32, dt: ti.f32, lengthening: ti.f32):
        """Applies the pressures for dt [s] in place of the particles' contact impulses of the last
        step, which are scaled by `lengthening` (-)."""
        for gap in range(found):
            k, other, pressure = self.sample[gap], self.other[gap], self.pressure[gap]
            b = self.owner[k]
            x = self._place(gap)
            if self.share[gap] < LEAST_SHARE:
                pressure = self._filled(found, b, x)
            area = self.boundary.rotation[b, BEGIN] @ self.area[k]
            missing = pressure - self.resolved[gap]
            push = -dt * self.weight[gap] * self.gaps.half(other) * missing * area
            self.impulses.push_body(b, push, x - self.boundary.centre[b, BEGIN])
            if self.gaps.is_floating(other):
                self.impulses.push_body(other, -push, x - self.boundary.centre[other, BEGIN])
        for b in range(self.constants.bodies[None]):
            self.impulses.body_push[b] -= lengthening * self.gaps.push[b]
            self.impulses.body_twist[b] -= lengthening * self.gaps.twist[b]

    @ti.func
    def _filled(self, found, b, x):
        """Returns the mean pressure [Pa] of the samples of body b in gaps that read water, weighted
        by 1/distance^4."""
        total, weights = 0.0, MIN_DIVISOR
        for gap in range(found):
            if self.owner[self.sample[gap]] == b and self.share[gap] >= LEAST_SHARE:
                weight = 1.0 / ti.max((self._place(gap) - x).norm_sqr(), 1e-12) ** 2
                total += weight * self.pressure[gap]
                weights += weight
        return total / weights
