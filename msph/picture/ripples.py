"""Small ripples where a hand or drops disturb the surface, by perturbing the normals only.

A height map over the floor, CELLS along the longest edge, follows the wave equation at the speed of
the slowest waves on water, with damping. It does not act on the water.
"""

import math

import taichi as ti

from msph.fluid.external_forces import HAND_NUMBERS, Hand
from msph.launches import data_oriented, kernel
from msph.picture.pixels import bilinear
from msph.picture.sky import noise
from msph.surface.thin_water import ThinWater

vec2, vec3 = ti.math.vec2, ti.math.vec3

CELLS = 160
# Speed [m/s] of the slowest waves on water (Lighthill 1978), largest Courant number (-), largest
# number of steps of a frame, and time of damping [s].
SPEED, COURANT, MOST_STEPS, DAMPING = 0.23, 0.6, 4, 0.35
# Speed of the surface under a drop that falls in, over the drop's; radius of the dent in spacings,
# and least radius in cells; distance from the surface within which a drop dents it, in spacings.
DENT, DENT_RADIUS, LEAST_RADIUS, CONTACT = 0.04, 0.7, 1.5, 1.5
# Speed of the chop around a hand, over the speed of the hand, and size of the chop in cells.
CHOP, CHOP_CELLS = 0.06, 2.0
# Smallest upward part of the normals that ripples change, and largest slope (-).
LEVEL, STEEPEST = 0.5, 0.35


@data_oriented
class Ripples:
    """Height map. height, before (CELLS, CELLS): h [m] after, before a step; slope: grad h (-)."""

    def __init__(self, thin: ThinWater, sunlight, lens):
        self.thin, self.sunlight, self.lens = thin, sunlight, lens
        self.height, self.before = (ti.field(ti.f32, (CELLS, CELLS)) for _ in range(2))
        self.slope = ti.Vector.field(2, ti.f32, (CELLS, CELLS))
        self.frames = 0  # seed of the chop
        self.started = False  # False while the surface is smooth

    def reset(self):
        """Makes the surface smooth."""
        self.frames, self.started = 0, False
        for field in (self.height, self.before, self.slope):
            field.fill(0.0)

    def advance(self, dt: float, hand: Hand, length: float) -> None:
        """Advances the ripples by dt [s] in a box whose longest edge is `length` [m]."""
        self.frames += 1
        self.started = self.started or any(hand.velocity) or self.thin.spray.count[None] > 0
        if not self.started:
            return
        cell = length / CELLS
        steps = min(math.ceil(SPEED * dt / (COURANT * cell)), MOST_STEPS)
        courant = min(SPEED * dt / (steps * cell), COURANT)
        self._disturb(dt, hand.numbers(), math.hypot(*hand.velocity), self.frames)
        for _ in range(steps):
            self._step(courant**2, math.exp(-dt / (steps * DAMPING)))
        self._find_slope()

    def compile(self) -> None:
        """Compiles the kernels, by launching them on a smooth surface without effect."""
        if not self.started:
            self._disturb(0.0, Hand().numbers(), 0.0, 0)
            self._step(0.0, 1.0)
            self._find_slope()

    @ti.func
    def size(self):
        """Returns the number of cells along x and z."""
        size = self.lens.shot[None].size
        return ti.min(ti.ceil(size.xz * (CELLS / size.max()), ti.i32), CELLS)

    @kernel
    def _disturb(self, dt: ti.f32, hand: HAND_NUMBERS, speed: ti.f32, frame: ti.i32):
        """Adds dents of drops that fall in, and the chop of the hand."""
        for k in range(self.thin.spray.count[None]):
            p, shot = self.thin.spray.loose[k], self.lens.shot[None]
            x, v, d = self.thin.particles.x[p], self.thin.particles.v[p], self.thin.spacing(p)
            above = x.y - self.sunlight.height(x, shot)
            if v.y < 0.0 and abs(above) < CONTACT * d:
                self.dent(x, DENT * dt * v.y, DENT_RADIUS * d, shot.size.max() / CELLS)
        for i, j in self.height:
            if hand[13] * speed > 0.0:
                shot = self.lens.shot[None]
                at = (vec2(i, j) + 0.5) * (shot.size.max() / CELLS)
                x = vec3(at.x, 0.0, at.y)
                x.y = self.sunlight.height(x, shot)
                r = (x - vec3(hand[0], hand[1], hand[2])) * vec3(hand[6], hand[7], hand[8])
                inside = ti.max(1.0 - r.norm_sqr(), 0.0)
                chop = noise(vec2(i, j) / CHOP_CELLS + 7.0 * (frame % 64)) - 0.5
                self.height[i, j] += CHOP * dt * speed * inside * chop

    @ti.func
    def dent(self, x, rise, radius, cell):
        """Adds a Gaussian dent of a radius [m] at x [m]; cell [m]: width of a cell."""
        c, r = x.xz / cell - 0.5, ti.max(radius / cell, LEAST_RADIUS)
        lo = ti.cast(ti.max(ti.ceil(c - 2.0 * r), 0.0), ti.i32)
        hi = ti.min(ti.cast(ti.floor(c + 2.0 * r), ti.i32), self.size() - 1)
        for i in range(lo.x, hi.x + 1):
            for j in range(lo.y, hi.y + 1):
                self.height[i, j] += rise * ti.exp(-(vec2(i, j) - c).norm_sqr() / (r * r))

    @kernel
    def _step(self, courant2: ti.f32, kept: ti.f32):
        """Makes a step: h' = kept (h + kept (h - before) + courant^2 (sum of neighbours - 4 h))."""
        for i, j in self.height:
            last, h = self.size() - 1, self.height[i, j]
            if i <= last.x and j <= last.y:
                around = self.height[ti.max(i - 1, 0), j] + self.height[ti.min(i + 1, last.x), j]
                around += self.height[i, ti.max(j - 1, 0)] + self.height[i, ti.min(j + 1, last.y)]
                ahead = h + kept * (h - self.before[i, j]) + courant2 * (around - 4.0 * h)
                self.before[i, j] = kept * ahead
        for i, j in self.height:
            h = self.height[i, j]
            self.height[i, j], self.before[i, j] = self.before[i, j], h

    @kernel
    def _find_slope(self):
        for i, j in self.slope:
            last, shot = self.size() - 1, self.lens.shot[None]
            if i <= last.x and j <= last.y:
                along_x = self.height[ti.min(i + 1, last.x), j] - self.height[ti.max(i - 1, 0), j]
                along_z = self.height[i, ti.min(j + 1, last.y)] - self.height[i, ti.max(j - 1, 0)]
                slope = vec2(along_x, along_z) * (0.5 * CELLS / shot.size.max())
                self.slope[i, j] = slope * ti.min(1.0, STEEPEST / ti.max(slope.norm(), STEEPEST))

    @ti.func
    def bend(self, p, n, shot: ti.template()):
        """Returns the unit normal n of the surface at p [m], up or down, with ripples."""
        found = n
        if shot.ripples == 1 and abs(n.y) > LEVEL:
            cells = p.xz * (CELLS / shot.size.max()) - 0.5
            g = bilinear(self.slope, ti.math.clamp(cells, 0.0, self.size() - 1.001))
            found = (n - ti.math.sign(n.y) * vec3(g.x, 0.0, g.y)).normalized()
        return found
