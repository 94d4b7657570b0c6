"""Pressure on bodies in gaps in which no particles fit.

Where a wall or another body is nearer than about a spacing, no particles fit, and those at the rim
press too little on the faces. There the water is taken to have the pressure of the water around
(Adami et al. 2012, Band et al. 2018): at a sample of the face, of area A and normal n, the mean of
p_i over the links i outside of gaps, weighted by s_i = V_i W, raised by the hydrostatic pressure
between particle and sample. This replaces what links exert there: a link is spread over the samples
around as normal forces A W (n.S) n that add up to G, with S = M^-1 G and M = sum A W n n^T. With
the share w of the sample that lies in the gap,

    V_i G_i += -w A n AT_FACE s_i/sum(s) - w A V_i W (n.S_i) n

before the pressures are solved, likewise T. Gaps are thus part of the same symmetric operator:
water around a gap that widens moves into it, and no energy is added. The opposite acts on the body
on the other side or on the wall. The hydrostatic part is an impulse on the body. Faces between
bodies in prescribed motion and walls are left out unless their forces are recorded.
"""

import numpy as np
import taichi as ti

from msph.fluid.boundary.body_faces import samples
from msph.fluid.boundary.body_shapes import BEGIN
from msph.fluid.boundary.walls import WALL, WALLS
from msph.fluid.external_forces import FIELD_NUMBERS, NO_HAND, ExternalForces, field_at
from msph.fluid.part import Part, Parts
from msph.fluid.particles import kernels
from msph.fluid.room import MAX_BODIES
from msph.fluid.small_numbers import MIN_DIVISOR
from msph.launches import data_oriented, heavy_kernel, kernel, small_kernel

vec3, vec4 = ti.math.vec3, ti.math.vec4

# Gap widths [finest spacings]: the pressure is extrapolated in full below NARROW, not above WIDE.
NARROW, WIDE = 1.2, 1.6
# Negative cosine between the normals of the two sides of a gap above which the sides face each
# other; below 0 they do not.
FACING = 0.5
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

# Pressure of water at a face over the multipliers of the particles there (-), which are up to 2 %
# too low. Without it a box 0.05 spacings from a wall is drawn to it by 2.6 instead of 1.2 % of its
# buoyancy.
AT_FACE = 1.015

# Length [m] larger than any scene, for the bounds of a body without samples in gaps.
FAR = 1e9

NUMBERS = ti.types.ndarray(dtype=ti.f32, ndim=2)
INTEGERS = ti.types.ndarray(dtype=ti.i32, ndim=1)


@data_oriented
class GapPressure(Part):
    """Samples of all bodies' faces in their frames, contiguous by body: points [m] and area vectors
    [m^2]. By body: first, its first sample; inside[first] to inside[end - 1], indices of those of
    its samples that are in gaps; lo, hi [m], bounds of these samples. By sample: weight (-), 0
    outside of gaps; other, the body on the other side (WALL for a wall); means over links outside
    of gaps, centre [m] and pressure [Pa], and their filled share (-); force [m^2] and torque [m^3]
    per unit of its pressure, including those of samples without such links. By link: outside (-),
    its share outside of gaps; spread, S (-)."""

    def __init__(self, parts: Parts):
        super().__init__(parts)
        capacity = MAX_BODIES * MAX_SAMPLES
        self.owner, self.other, self.inside = (ti.field(ti.i32, shape=capacity) for _ in range(3))
        self.weight, self.share, self.pressure = (
            ti.field(ti.f32, shape=capacity) for _ in range(3)
        )
        self.point, self.area, self.centre, self.force, self.torque = (
            ti.Vector.field(3, ti.f32, shape=capacity) for _ in range(5)
        )
        self.first = ti.field(ti.i32, shape=MAX_BODIES + 1)
        self.end = ti.field(ti.i32, shape=MAX_BODIES)
        self.lo, self.hi = (ti.Vector.field(3, ti.f32, shape=MAX_BODIES) for _ in range(2))
        self.outside = ti.field(ti.f32, shape=self.links.capacity)
        self.spread = ti.Vector.field(3, ti.f32, shape=self.links.capacity)
        self.recorded, self.count, self.idle = False, 0, False

    def record(self) -> None:
        """Adds the faces of bodies in prescribed motion, since forces on them are recorded."""
        if not self.recorded:
            self.recorded = True
            self.load()

    def load(self) -> None:
        """Takes the samples of the boundary's present bodies; compiles all kernels."""
        edge, bodies = EDGE * self.layers.finest.spacing, self.boundary.bodies
        self.idle = not (self.boundary.floating.count or (self.recorded and bodies))
        if not self.idle:
            clouds = [samples(body, edge, MAX_SAMPLES) for body in bodies]
            self.count = sum(len(points) for points, _ in clouds)
            owner = np.repeat(np.arange(len(clouds)), [len(points) for points, _ in clouds])
            points, areas = (np.concatenate(part) for part in zip(*clouds, strict=True))
            table = np.column_stack([points, areas]).astype(np.float32)
            self._store(
                table,
                owner.astype(np.int32),
                np.searchsorted(owner, np.arange(len(clouds) + 1)).astype(np.int32),
            )
            self._read(0)
            self._find_forces(0, 0.0, NO_HAND.field())
            self._add(0)

    @kernel
    def _store(self, table: NUMBERS, owner: INTEGERS, first: INTEGERS):
        for b in range(first.shape[0]):
            self.first[b] = first[b]
        for k in range(table.shape[0]):
            self.point[k] = vec3(table[k, 0], table[k, 1], table[k, 2])
            self.area[k] = vec3(table[k, 3], table[k, 4], table[k, 5])
            self.owner[k] = owner[k]

    def push(self, dt: float, external: ExternalForces) -> None:
        """Adds the water in gaps to the gradients of links, at the poses at the beginning of the
        second half of the step of dt [s], and applies the hydrostatic part. Links must be fresh."""
        if self.idle or not self.boundary.close_together(WIDE * self.layers.finest.spacing):
            return
        found = self._find_gaps(self.count, int(self.recorded))
        self.idle = not found and not self.boundary.moving
        if found:
            links = self.links.found[None]
            self._read(links)
            self._find_forces(self.count, dt, external.field())
            self._add(links)
            self.contact.push_moving()

    @small_kernel
    def _find_gaps(self, count: ti.i32, every: ti.i32) -> ti.i32:
        """Finds the samples in gaps; returns their number. every: 1 to include samples at which
        neither side floats."""
        for k in range(count):
            b = self.owner[k]
            x = self._place(k)
            normal = self.boundary.rotation[b, BEGIN] @ self.area[k].normalized(MIN_DIVISOR)
            weight, other = self._side(b, x, vec4(0.0, normal[0], normal[1], normal[2]))
            matters = every == 1 or self._floats(b) or self._floats(other)
            if weight > 0.0 and matters and self._is_free(b, x):
                self.other[k] = other
            else:
                weight = 0.0
            self.weight[k] = weight
            self.share[k] = self.pressure[k] = 0.0
            self.centre[k] = self.force[k] = self.torque[k] = vec3(0.0)
        found = 0
        for b in range(self.constants.bodies[None]):
            lo, hi, end = vec3(FAR), vec3(-FAR), self.first[b]
            for k in range(self.first[b], self.first[b + 1]):
                if self.weight[k] > 0.0:
                    lo, hi = ti.min(lo, self.point[k]), ti.max(hi, self.point[k])
                    self.inside[end] = k
                    end += 1
            self.lo[b], self.hi[b], self.end[b] = lo, hi, end
            found += end - self.first[b]
        return found

    @ti.func
    def _place(self, k):
        """Returns the position [m] of sample k."""
        b = self.owner[k]
        return self.boundary.centre[b, BEGIN] + self.boundary.rotation[b, BEGIN] @ self.point[k]

    @ti.func
    def _side(self, b, x, away):
        """Returns the share (-) of a gap at x [m] that is extrapolated, and the body on the other
        side, or WALL; away: distance [m] from body b and its unit normal at x."""
        spacing, best, other = self.constants.finest_spacing[None], 0.0, WALL
        for a in range(-WALLS, self.constants.bodies[None]):
            if a != b:
                near = self.boundary.near(a, x, WIDE * spacing, BEGIN)
                width = (near.x + ti.max(away.x, 0.0)) / spacing
                narrow = ti.math.clamp((WIDE - width) / (WIDE - NARROW), 0.0, 1.0)
                facing = ti.math.clamp(-away.yzw.dot(near.yzw) / FACING, 0.0, 1.0)
                if narrow * facing > best:
                    best, other = narrow * facing, ti.select(a < 0, WALL, a)
        return best, other

    @ti.func
    def _is_free(self, b, x):
        """Returns False if x [m] is in a wall or in another body than b."""
        free, depth = True, INSIDE * self.constants.finest_spacing[None]
        for a in range(-WALLS, self.constants.bodies[None]):
            if a != b:
                free = free and self.boundary.near(a, x, 0.0, BEGIN).x > -depth
        return free

    @ti.func
    def _floats(self, other):
        return self.boundary.inverse_mass[other] > 0.0

    @ti.func
    def _opposite(self, link, other):
        """Returns the link of the same particle and mirrors with body `other`, -1 without one."""
        i, found = self.links.particle[link], -1
        first = self.particles.first_link[i]
        for k in range(first, first + self.particles.links[i]):
            if self.links.body[k] == other and self.links.mirrors[k] == self.links.mirrors[link]:
                found = k
        return found

    @ti.func
    def _weight_at(self, link, place, h, k):
        """Returns s_i of a link at `place` [m] in the body's frame at sample k (-)."""
        volume = self.layers.volume[self.particles.layer[self.links.particle[link]]]
        found = self.outside[link] * volume * kernels.wendland((place - self.point[k]).norm(), h)
        if found > 0.0 and self._floats(self.other[k]):
            if self._opposite(link, self.other[k]) < 0:
                found = 0.0
        return found

    @ti.func
    def _near_gap(self, b, place, h):
        """Returns True if a sample of body b in a gap may be within h [m] of `place` [m] in its
        frame."""
        return (place - self.lo[b]).min() > -h and (self.hi[b] - place).min() > -h

    @heavy_kernel
    def _read(self, n: ti.i32):
        """Sums the links over the samples in gaps."""
        for link in range(n):
            b, i = self.links.body[link], self.links.particle[link]
            h, x = self.boundary.support[self.particles.layer[i]], self.particles.x[i]
            turn = self.boundary.rotation[b, BEGIN].transpose()
            place, moment = turn @ self.links.place[link], ti.Matrix.zero(ti.f32, 3, 3)
            if self._near_gap(b, place, h):
                for k in range(self.first[b], self.first[b + 1]):
                    r2, area = (place - self.point[k]).norm_sqr(), self.area[k]
                    if r2 < h * h:
                        w = kernels.wendland(ti.sqrt(r2), h) / ti.max(area.norm(), MIN_DIVISOR)
                        moment += w * area.outer_product(area)
                trace, spread = moment.trace(), vec3(0.0)
                if trace * h > MIN_TRACE:
                    moment += EVEN * trace * ti.Matrix.identity(ti.f32, 3)
                    spread = moment.inverse() @ (turn @ self.links.gradient[link])
                self.spread[link] = spread
                self.outside[link] = 1.0 - self._side(b, x, self.boundary.distance(b, x, BEGIN))[0]
                for m in range(self.first[b], self.end[b]):
                    k = self.inside[m]
                    s = self._weight_at(link, place, h, k)
                    self.share[k] += s
                    self.centre[k] += s * place
                    self.pressure[k] += s * ti.max(self.particles.pressure[i], 0.0)

    @kernel
    def _find_forces(self, count: ti.i32, dt: ti.f32, field: FIELD_NUMBERS):
        """Finds forces and torques by unit of pressure, and pushes bodies by the hydrostatic parts
        for dt [s]."""
        for k in range(count):
            if self.share[k] >= LEAST_SHARE:
                self.centre[k] /= self.share[k]
                self.pressure[k] /= self.share[k]
        for k in range(count):
            if self.weight[k] > 0.0:
                b, other = self.owner[k], self.other[k]
                force = -AT_FACE * self._half(k) * self.area[k]
                centre, pressure, total = vec3(0.0), 0.0, MIN_DIVISOR
                own = self.share[k] >= LEAST_SHARE
                begin, end = self.first[b], ti.select(own, self.first[b] + 1, self.end[b])
                for s in range(begin, end):
                    total += self._nearness(k, ti.select(own, k, self.inside[s]))
                for s in range(begin, end):
                    m = ti.select(own, k, self.inside[s])
                    part = self._nearness(k, m) / total
                    if part > 0.0:
                        centre += part * self.centre[m]
                        pressure += part * self.pressure[m]
                        self.force[m] += part * force
                        self.torque[m] += part * self.point[k].cross(force)
                turn, x = self.boundary.rotation[b, BEGIN], self._place(k)
                gravity = field_at(x - 0.5 * self.constants.size[None], field)
                rise = self.constants.rest_density[None] * gravity.dot(
                    turn @ (self.point[k] - centre)
                )
                push = dt * ti.math.clamp(rise, -pressure, pressure) * (turn @ force)
                self._push(b, x, push)
                if self._floats(other):
                    self._push(other, x, -push)

    @ti.func
    def _nearness(self, k, m):
        """Returns the weight (-) at which sample k reads the pressure of sample m of the same body:
        1/distance^4, 0 if m reads none or lies in a gap to another body."""
        found = 0.0
        if self.share[m] >= LEAST_SHARE and self.other[m] == self.other[k]:
            way = (self.point[k] - self.point[m]).norm() / self.constants.finest_spacing[None]
            found = 1.0 / ti.max(way, 1e-3) ** 4
        return found

    @ti.func
    def _push(self, b, x, push):
        """Adds an impulse [N s] on body b at x [m]."""
        self.impulses.body_push[b] += push
        self.impulses.body_twist[b] += (x - self.boundary.centre[b, BEGIN]).cross(push)

    @heavy_kernel
    def _add(self, n: ti.i32):
        """Replaces the forces of links at samples in gaps by those of the links around."""
        for link in range(n):
            b, i = self.links.body[link], self.links.particle[link]
            h = self.boundary.support[self.particles.layer[i]]
            place = self.boundary.rotation[b, BEGIN].transpose() @ self.links.place[link]
            if self._near_gap(b, place, h):
                volume = self.layers.volume[self.particles.layer[i]]
                for m in range(self.first[b], self.end[b]):
                    k = self.inside[m]
                    r = (place - self.point[k]).norm()
                    if r < h:
                        force = torque = vec3(0.0)
                        if self.share[k] >= LEAST_SHARE:
                            part = self._weight_at(link, place, h, k) / (volume * self.share[k])
                            force, torque = part * self.force[k], part * self.torque[k]
                        normal = self.area[k].normalized(MIN_DIVISOR)
                        w = self._half(k) * kernels.wendland(r, h)
                        own = -w * self.spread[link].dot(normal) * self.area[k]
                        self._add_to(link, k, force + own, torque + self.point[k].cross(own))

    @ti.func
    def _half(self, k):
        """Returns the share (-) of sample k that is replaced: half if the other side floats, whose
        samples replace the other half."""
        return self.weight[k] * ti.select(self._floats(self.other[k]), 0.5, 1.0)

    @ti.func
    def _add_to(self, link, k, force, torque):
        """Adds a force [1/m] and torque (-) at sample k, in the frame of its body, to a link, and
        the opposite to the same particle's link with a floating body on the other side. Without
        such a link nothing is added."""
        b, other, opposite = self.owner[k], self.other[k], link
        turn = self.boundary.rotation[b, BEGIN]
        push, twist = turn @ force, turn @ torque
        if self._floats(other):
            opposite = self._opposite(link, other)
            if opposite >= 0:
                arm = self.boundary.centre[b, BEGIN] - self.boundary.centre[other, BEGIN]
                self.links.gradient[opposite] -= push
                self.links.torque[opposite] -= twist + arm.cross(push)
        if opposite >= 0:
            self.links.gradient[link] += push
            self.links.torque[link] += twist
