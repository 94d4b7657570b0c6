"""Position correction: moves crowded particles apart without adding velocity.

A few Jacobi iterations reduce the density excess. Conjugate gradients would find the long, nearly
free modes of a regular arrangement: large displacements without linearised compression.

The last round starts with a common background pressure (Adami et al. 2013), which spreads particles
evenly: disordered particles of density 1 fill more space than evenly spread particles. It is
proportional to the particle's motion in the step (Skillen et al. 2013), since motion disturbs the
arrangement (docs/method.md, "Position correction").
"""

import math

import taichi as ti

from msph.fluid.boundary.body_shapes import BEGIN
from msph.fluid.particles.particles import Attribute
from msph.fluid.projection.density import MIN_DISTANCE
from msph.fluid.projection.discretisation import Discretisation
from msph.fluid.projection.parameters import MOTION_FACTOR
from msph.fluid.small_numbers import MIN_DIVISOR
from msph.launches import data_oriented, kernel

ATTRIBUTES = (
    Attribute("position_multiplier", "m^2", "unknown of the position correction", carried=False),
    Attribute("position_correction", "m", "displacement that ends crowding", 3, carried=False),
    Attribute("crowding", "-", "2: corrected first, 1: displaced", integer=True, carried=False),
    Attribute("velocity_exchange", "m/s", "change by neighbours", 3, carried=False),
    Attribute("exchange_share", "-", "largest share of its exchanges", carried=False),
    Attribute("relative_speed", "m/s", "largest past neighbours and walls", carried=False),
)

# Rounds of iterations by the largest density excess (-): waves exceed 0.02, halves of a split 0.06.
# With three rounds for both, up to 1 % excess was left in rocking layers instead of 0.5 to 0.7 %.
ROUNDS_BY_EXCESS = {0.02: 3, 0.06: 4}
# Density excess (-) above which all rounds but the last correct a particle and its neighbours.
CROWDED_EXCESS = 0.005
# Background pressure, as a density excess, and the deficit above which it is off (-). It lowers the
# stiffness against shear: at 0.0265 water 15 spacings deep sloshes 1 % too slowly.
BACKGROUND_EXCESS, BACKGROUND_DEFICIT = 0.014, 0.03
# Motion in a step, in spacings, at which the background is full, and its share (-) at rest. With a
# share of 1, waves of half a spacing oscillate 4.9 % too slowly instead of 2.9 %.
FULL_MOTION, REST_SHARE = 0.1, 0.3
# Under-relaxation of Jacobi: RELAXATION over the number of neighbours, at most MAX_RELAXATION.
# Stable below 2/lambda_max, which was 0.68, 0.53 and 0.31 at 27, 57 and 97 neighbours.
RELAXATION, MAX_RELAXATION = 24.0, 0.5
# MOTION_FACTOR (-) of spray, which passes no neighbours.
SPRAY_MOTION_FACTOR = 2.5
# Values of `crowding`: neither displaced nor corrected first, displaced, both.
CALM, DISPLACED, CORRECTED = 0, 1, 2


@data_oriented
class PositionCorrection(Discretisation):
    """Finds displacements of at most `largest_shift` spacings, and applies them."""

    def load(self, iterations: int) -> None:
        """Sets the number of iterations per round."""
        self.iterations = iterations
        self.crowded = False  # True if the largest excess takes several rounds
        # Compiled here (launched on no particles), so that the first splash does not wait.
        self._mark_crowds(0)
        self._limit_exchange(0)

    def find(self, dt: float) -> float:
        """Finds displacements that end crowding in a step of dt [s]; returns the largest density
        excess (-). dt = 0, before time starts: the background is full everywhere."""
        n = self.particles.count
        largest = self.density.largest_excess
        rounds = max((r for excess, r in ROUNDS_BY_EXCESS.items() if largest > excess), default=1)
        self.crowded = rounds > 1
        # The background acts in the last round only: further iterations would undo its spreading.
        if self.crowded:
            self._mark_crowds(n)
            for _ in range((rounds - 1) * self.iterations):
                self._relax(n, dt, 0.0, CORRECTED)
            self._relax(n, dt, 1.0, CALM)
        else:
            self._relax_from_zero(n, dt)
        for _ in range(self.iterations - 1):
            self._relax(n, dt, 0.0, CALM)
        return largest

    @kernel
    def _relax_from_zero(self, n: ti.i32, dt: ti.f32):
        """Runs _relax() from q = 0, with the background."""
        p = self.particles
        for i in range(n):
            r = self.density.excess(i) + self._background(i, dt)
            p.position_multiplier[i] = self.relaxed(i, 0.0, r)
        for i in range(n):
            p.position_correction[i] = self.operator.displacement(i, p.position_multiplier)

    @kernel
    def _mark_crowds(self, n: ti.i32):
        """Sets q = 0, u = 0 and the crowding: CORRECTED for particles of an excess above
        CROWDED_EXCESS and their neighbours, DISPLACED for other neighbours of these particles."""
        p = self.particles
        for i in range(n):
            p.position_multiplier[i], p.crowding[i] = 0.0, CALM
            p.position_correction[i] = ti.Vector([0.0, 0.0, 0.0])
        # Threads may mark the same particle, all with the same value.
        for i in range(n):
            if self.density.excess(i) > CROWDED_EXCESS:
                p.crowding[i] = CORRECTED
                for s in range(self.neighbours.start[i], self.neighbours.end[i]):
                    p.crowding[self.neighbours.index[s]] = CORRECTED
        for i in range(n):
            if p.crowding[i] == CORRECTED:
                for s in range(self.neighbours.start[i], self.neighbours.end[i]):
                    j = self.neighbours.index[s]
                    if p.crowding[j] == CALM:
                        p.crowding[j] = DISPLACED

    @kernel
    def _relax(self, n: ti.i32, dt: ti.f32, background: ti.f32, crowding: ti.i32):
        """q += omega r/D, at least 0, with r = c - 1 + sum V_j (u_i - u_j).grad W_ij, the
        displacements u in position_correction; `background` (-) times the background is added.

        Corrects the particles of at least this crowding; displaces particles of one less, too.
        """
        p = self.particles
        for i in range(n):
            if p.crowding[i] >= crowding:
                r = self.density.excess(i) + self.operator.divergence(i, p.position_correction)
                r += background * self._background(i, dt)
                p.position_multiplier[i] = self.relaxed(i, p.position_multiplier[i], r)
        for i in range(n):
            if p.crowding[i] >= crowding - 1:
                p.position_correction[i] = self.operator.displacement(i, p.position_multiplier)

    @ti.func
    def relaxed(self, i, q, r):
        """Returns q + omega r/D, at least 0; r is the compression that q leaves."""
        diagonal = ti.max(self.particles.diagonal[i], MIN_DIVISOR)
        return ti.max(q + self.constants.relaxation[None] * r / diagonal, 0.0)

    @ti.func
    def _background(self, i, dt):
        """Returns the background pressure as a density excess (-): 0 where excess() is a deficit
        above BACKGROUND_DEFICIT, so that it acts at plane surfaces and not in spray."""
        motion = dt * self.particles.v[i].norm() / self.layers.spacing[self.particles.layer[i]]
        share = ti.select(dt > 0.0, ti.math.clamp(motion / FULL_MOTION, REST_SHARE, 1.0), 1.0)
        inside = self.density.excess(i) > -BACKGROUND_DEFICIT
        return ti.select(inside, share * BACKGROUND_EXCESS, 0.0)

    def apply(self, dt: float) -> list[float]:
        """Applies the displacements that find() found, except into walls and bodies. Returns the
        largest rate [1/s] by which motion bounds the next step (speed over cfl spacings), and the
        longest distance that a particle moves in dt [s], in spacings, of spray divided by
        SPRAY_MOTION_FACTOR."""
        if self.crowded:
            self._limit_exchange(self.particles.count)
        return self._apply(self.particles.count, dt, int(self.crowded))

    @kernel
    def _limit_exchange(self, n: ti.i32):
        """Sets the share of their velocity exchange that particles take part in: 1, or less if they
        would give away more than their own velocity."""
        p = self.particles
        for i in range(n):
            total = 0.0
            for s in range(self.neighbours.start[i], self.neighbours.end[i]):
                total += self._exchange(i, s)
            p.exchange_share[i] = 1.0 / ti.max(total, 1.0)

    @ti.func
    def _exchange(self, i, s):
        """Returns a_ij (-) of _apply() for entry s of particle i, without the limit by shares."""
        p, j = self.particles, self.neighbours.index[s]
        r_ij = p.x[i] - p.x[j]
        slope = self.pair_gradient[s].dot(r_ij) / ti.max(r_ij.norm_sqr(), MIN_DISTANCE**2)
        return -slope * (p.position_multiplier[i] + p.position_multiplier[j])

    @kernel
    def _apply(self, n: ti.i32, dt: ti.f32, crowded: ti.i32) -> ti.math.vec2:
        """x += position_correction, at most `largest_shift` spacings; requires the list of find().

        A pair that is moved apart to r (1 + a) keeps its angular momentum only if its relative
        velocity shrinks by a: v_i -= sum a_ij (v_i - v_j), a_ij = -(q_i + q_j) V_j W'/r >= 0. This
        also keeps the momentum, and adds no energy while sum a_ij <= 1, to which the shares of both
        limit a_ij where particles are crowded. The same pass finds the relative speeds.
        """
        p = self.particles
        for i in range(n):
            change = ti.Vector([0.0, 0.0, 0.0])
            v, x = p.v[i], p.x[i]
            fastest = self._speed_past_walls(i, x, v) ** 2
            for s in range(self.neighbours.start[i], self.neighbours.end[i]):
                j = self.neighbours.index[s]
                relative, a = v - p.v[j], self._exchange(i, s)
                if crowded == 1:
                    a *= ti.min(p.exchange_share[i], p.exchange_share[j])
                change -= a * relative
                fastest = ti.max(fastest, relative.norm_sqr())
            p.velocity_exchange[i] = change
            p.relative_speed[i] = ti.sqrt(fastest)
            m = self.layers.mass[p.layer[i]]
            self.impulses.record_internal(i, m, x, change)
            wall = self.operator.wall_displacement(i, p.position_multiplier)
            inner = self._limit(i) * (p.position_correction[i] - wall)
            self.impulses.internal_angular_impulse.add(i, m * inner.cross(v + change))
        top, longest, cfl = 0.0, 0.0, self.constants.cfl[None]
        rest_density = self.constants.rest_density[None]
        ti.loop_config(serialize=self.traits.light)
        for i in range(n):
            x, margin = p.x[i] + self._limit(i) * p.position_correction[i], self.contact.margin(i)
            x = self.walls.confined(p.x[i], x, margin)
            if ti.static(self.traits.bodies):
                if p.links[i] > 0:
                    x = self.contact.cleared(x, margin, BEGIN)
            p.x[i] = x
            # Before time starts (dt = 0) water keeps its initial velocities.
            if dt > 0.0:
                p.v[i] += p.velocity_exchange[i]
            d, speed = self.layers.spacing[p.layer[i]], p.v[i].norm()
            relative = ti.math.clamp(p.relative_speed[i], speed / MOTION_FACTOR, speed)
            if p.predicted_density[i] < self.constants.spray[None] * rest_density:
                speed /= SPRAY_MOTION_FACTOR  # in the distance, too
                relative = speed
            # Compared first, since a GPU executes atomic maxima of one number one by one.
            if speed * dt / d > longest:
                ti.atomic_max(longest, speed * dt / d)
            if relative / (cfl * d) > top:
                ti.atomic_max(top, relative / (cfl * d))
        return ti.Vector([top, longest])

    @ti.func
    def _speed_past_walls(self, i, x, v):
        """Returns the largest speed [m/s] at which walls within reach of x approach or recede;
        |v| near bodies, whose faces may have any direction."""
        h = self.layers.support[self.particles.layer[i]]
        speed, near = 0.0, self.walls.near(x, h)
        for k in ti.static(range(3)):
            meets = ((near >> k) | (near >> (k + 3))) & 1
            speed = ti.max(speed, meets * abs(v[k]))
        by_body = self.particles.image_end[i] > self.particles.body_image[i]
        return ti.select(by_body, v.norm(), speed)

    @ti.func
    def _limit(self, i):
        """Returns the factor (-) that limits the displacement to `largest_shift` spacings."""
        d = self.layers.spacing[self.particles.layer[i]]
        length = ti.max(self.particles.position_correction[i].norm(), MIN_DIVISOR)
        return ti.min(1.0, self.constants.largest_shift[None] * d / length)


def relaxation(smoothing: float) -> float:
    """Returns the under-relaxation of Jacobi (-) for the largest support over spacing."""
    return min(MAX_RELAXATION, RELAXATION / (4.0 / 3.0 * math.pi * smoothing**3))
