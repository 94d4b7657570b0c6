"""Pressure on bodies in gaps in which no particles fit.

Where a wall or another body is nearer than about a spacing, no particles fit, and those at the rim
press too little on the faces. There the pressure is extrapolated to samples of the face from the
water around (Adami et al. 2012, Band et al. 2018): the mean over the particles outside of gaps,
raised by the hydrostatic pressure between particle and sample, and where none is within reach, the
mean over the nearest samples of the same body. This pressure replaces forces of particles there:
their contact impulses (gaps.py), and those of their links, V_i p_i G with the multipliers p_i. For
these, a link is spread over the samples around, of areas A and normals n, as normal forces
A W (n.S) n that add up to G: S = M^-1 G, M = sum A W n n^T. The opposite acts on the floating body
on the other side. Pressures and impulses are those of the last step.
"""

import numpy as np
import taichi as ti

from msph.fluid.boundary.body_faces import samples
from msph.fluid.boundary.body_links import BodyLinks
from msph.fluid.boundary.body_shapes import BEGIN
from msph.fluid.boundary.contact import Contact
from msph.fluid.boundary.gaps import WIDE
from msph.fluid.external_forces import FIELD_NUMBERS, NO_HAND, ExternalForces, field_at
from msph.fluid.particles import kernels
from msph.fluid.particles.grid import LayeredGrid
from msph.fluid.particles.mirrors import Mirrors
from msph.fluid.room import MAX_BODIES
from msph.fluid.small_numbers import MIN_DIVISOR
from msph.launches import data_oriented, heavy_kernel, kernel

vec3, vec4 = ti.math.vec3, ti.math.vec4

# Largest edge of a sample, in finest spacings, and largest number of samples of a body.
EDGE, MAX_SAMPLES = 1.2, 2000
# Depth [finest spacings] in a wall or another body at which a sample has no water in front of it.
INSIDE = 0.5
# Least share (-) of the kernel that particles outside of gaps fill at a sample whose pressure is
# read from them.
LEAST_SHARE = 0.05
# Least trace of M, times the support (-), by which a link is spread. What is added to M, over its
# trace (-): forces along a face are not spread.
MIN_TRACE, EVEN = 1e-3, 0.02
# Speed [m/s] of floating bodies at which impulses along their motion have faded out: unfaded, they
# added 0.6 % of the energy to a body dragged along a wall.
DRIVEN_SPEED = 0.01

NUMBERS = ti.types.ndarray(dtype=ti.f32, ndim=2)
INTEGERS = ti.types.ndarray(dtype=ti.i32, ndim=1)
# Sums at a sample: the kernel's filled share (-), share times extrapolated pressure [Pa], and
# `resolved`, the links' pressure [Pa]; `at` is the sample mirrored by `mirrors`, `normal` that of
# the body there.
Reading = ti.types.struct(
    **{"at": vec3, "sample": vec3, "gravity": vec3, "layer": ti.i32},
    **{"body": ti.i32, "mirrors": ti.i32, "normal": vec3},
    **{"share": ti.f32, "pressure": ti.f32, "resolved": ti.f32},
)


@data_oriented
class GapPressure:
    """Samples of all bodies' faces in their frames, contiguous by body: points [m] and area vectors
    [m^2]; by body: first, its first sample, and in_gap, 1 if any is in a gap; by sample in a gap:
    sample, other body (WALL for a wall), weight (-), filled share (-), pressure, and resolved, the
    links' pressure [Pa]; by link: spread, S (-); by body: push_sum [N s], twist_sum [N m s], the
    impulses of a step."""

    def __init__(self, links: BodyLinks, grid: LayeredGrid, contact: Contact):
        boundary = contact.boundary
        self.boundary, self.contact, self.grid, self.links = boundary, contact, grid, links
        self.constants, self.layers, self.gaps = boundary.constants, boundary.layers, contact.gaps
        self.particles, self.impulses = contact.particles, contact.impulses
        self.images = Mirrors(boundary.constants)
        capacity = MAX_BODIES * MAX_SAMPLES
        self.owner, self.sample, self.other = (ti.field(ti.i32, shape=capacity) for _ in range(3))
        self.point, self.area = (ti.Vector.field(3, ti.f32, shape=capacity) for _ in range(2))
        self.weight, self.share, self.pressure, self.resolved = (
            ti.field(ti.f32, shape=capacity) for _ in range(4)
        )
        self.first, self.in_gap = (ti.field(ti.i32, shape=MAX_BODIES + 1) for _ in range(2))
        self.spread = ti.Vector.field(3, ti.f32, shape=links.capacity)
        self.push_sum, self.twist_sum = (
            ti.Vector.field(3, ti.f32, shape=MAX_BODIES) for _ in range(2)
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
            self._store(
                table,
                owner.astype(np.int32),
                np.searchsorted(owner, np.arange(len(clouds) + 1)).astype(np.int32),
            )
            self._spread_links(0)
            self._read(0, NO_HAND.field())
            self._push(0, 0.0, 0.0, NO_HAND.field())

    @kernel
    def _store(self, table: NUMBERS, owner: INTEGERS, first: INTEGERS):
        for b in range(first.shape[0]):
            self.first[b] = first[b]
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
            self._spread_links(self.links.found[None])
            self._read(found, external.field())
            self._push(found, dt, dt / self.last_step, external.field())
            self.gaps.clear()
            self.contact.push_moving()
            self.boundary.redo(0.5 * dt)
        self.last_step = dt
        return found > 0

    @kernel
    def _find_gaps(self, count: ti.i32) -> ti.i32:
        """Finds the samples in gaps; returns their number."""
        self.found[None] = 0
        for b in range(self.constants.bodies[None]):
            self.in_gap[b] = 0
        for k in range(count):
            b = self.owner[k]
            turn = self.boundary.rotation[b, BEGIN]
            x = self.boundary.centre[b, BEGIN] + turn @ self.point[k]
            normal = (turn @ self.area[k]).normalized(MIN_DIVISOR)
            weight, other = self.gaps.side(b, x, vec4(0.0, normal[0], normal[1], normal[2]), BEGIN)
            if weight > 0.0 and self._is_free(b, x):
                gap = ti.atomic_add(self.found[None], 1)
                self.sample[gap], self.other[gap], self.weight[gap] = k, other, weight
                self.in_gap[b] = 1
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
    def _spread_links(self, n: ti.i32):
        """Finds how the first n links spread over the samples of bodies with gaps."""
        for link in range(n):
            b = self.links.body[link]
            if self.in_gap[b] == 1:
                h = self.boundary.support[self.particles.layer[self.links.particle[link]]]
                turn = self.boundary.rotation[b, BEGIN].transpose()
                place, moment = turn @ self.links.place[link], ti.Matrix.zero(ti.f32, 3, 3)
                for k in range(self.first[b], self.first[b + 1]):
                    r, area = (place - self.point[k]).norm(), self.area[k]
                    if r < h:
                        w = kernels.wendland(r, h) / ti.max(area.norm(), MIN_DIVISOR)
                        moment += w * area.outer_product(area)
                trace, spread = moment.trace(), vec3(0.0)
                if trace * h > MIN_TRACE:
                    moment += EVEN * trace * ti.Matrix.identity(ti.f32, 3)
                    spread = moment.inverse() @ (turn @ self.links.gradient[link])
                self.spread[link] = turn.transpose() @ spread

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
            share = self.layers.volume[layer] * kernels.wendland((reading.at - x).norm(), h)
            multiplier = self.particles.pressure_multiplier[i]
            # At faces multipliers are up to 2 % too low, virial pressures as much too high.
            own = ti.max(0.5 * (multiplier + self.particles.pressure[i]), 0.0)
            rise = self.constants.rest_density[None] * reading.gravity.dot(reading.sample - x)
            rise = ti.math.clamp(rise, -own, own)
            reading.resolved += share * (multiplier + rise) * self._pressure_per_share(i, reading)
            away = self.boundary.distance(reading.body, x, BEGIN)
            share *= 1.0 - self.gaps.side(reading.body, x, away, BEGIN)[0]
            reading.share += share
            reading.pressure += share * (own + rise)

    @ti.func
    def _pressure_per_share(self, i, reading: ti.template()):
        """Returns the pressure (-) of particle i's link at the sample by the unit of multiplier and
        share; 0 without a link."""
        first, found = self.particles.first_link[i], 0.0
        for link in range(first, first + self.particles.links[i]):
            same = self.links.mirrors[link] == reading.mirrors
            if same and self.links.body[link] == reading.body:
                found = -self.spread[link].dot(reading.normal)
        return found

    @kernel
    def _push(self, found: ti.i32, dt: ti.f32, lengthening: ti.f32, field: FIELD_NUMBERS):
        """Applies the pressures for dt [s] in place of the particles' contact impulses of the last
        step, which are scaled by `lengthening` (-)."""
        centre = 0.5 * self.constants.size[None]
        for b in range(self.constants.bodies[None]):
            self.push_sum[b] = -lengthening * self.gaps.push[b]
            self.twist_sum[b] = -lengthening * self.gaps.twist[b]
        for gap in range(found):
            k, other, pressure = self.sample[gap], self.other[gap], self.pressure[gap]
            b = self.owner[k]
            x = self._place(gap)
            if self.share[gap] < LEAST_SHARE:
                pressure = self._filled(found, b, x, field_at(x - centre, field))
            area = self.boundary.rotation[b, BEGIN] @ self.area[k]
            missing = pressure - self.resolved[gap]
            push = -dt * self.weight[gap] * self.gaps.half(other) * missing * area
            self._add(b, x, push)
            if self.gaps.is_floating(other):
                self._add(other, x, -push)
        share = self._share_without_gain()
        for b in range(self.constants.bodies[None]):
            self.impulses.body_push[b] += share * self.push_sum[b]
            self.impulses.body_twist[b] += share * self.twist_sum[b]

    @ti.func
    def _add(self, b, x, push):
        """Adds an impulse [N s] on body b at x [m] to its sums."""
        self.push_sum[b] += push
        self.twist_sum[b] += (x - self.boundary.centre[b, BEGIN]).cross(push)

    @ti.func
    def _share_without_gain(self):
        """Returns the share (-) of all impulses that is applied. The water receives no opposite
        impulses, so impulses along the motion of floating bodies would add energy; the share falls
        with the speed of this motion."""
        work, size = 0.0, MIN_DIVISOR
        ti.loop_config(serialize=True)
        for b in range(self.constants.bodies[None]):
            if self.boundary.inverse_mass[b] > 0.0:
                push, twist = self.push_sum[b], self.twist_sum[b]
                work += push.dot(self.boundary.velocity[b, BEGIN])
                work += twist.dot(self.boundary.spin[b, BEGIN])
                size += push.norm()
        return ti.math.clamp(1.0 - work / (DRIVEN_SPEED * size), 0.0, 1.0)

    @ti.func
    def _filled(self, found, b, x, gravity):
        """Returns the mean pressure [Pa] of the samples of body b in gaps that read water, raised
        by the hydrostatic pressure between them and x [m] and weighted by 1/distance^4."""
        total, weights = 0.0, MIN_DIVISOR
        for gap in range(found):
            if self.owner[self.sample[gap]] == b and self.share[gap] >= LEAST_SHARE:
                way = x - self._place(gap)
                weight = 1.0 / ti.max(way.norm_sqr(), 1e-12) ** 2
                rise = self.constants.rest_density[None] * gravity.dot(way)
                total += weight * ti.max(self.pressure[gap] + rise, 0.0)
                weights += weight
        return total / weights
