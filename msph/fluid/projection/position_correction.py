"""The position correction: crowded particles move apart, without gaining velocity.

A few iterations of Jacobi on the density excess. Unlike conjugate gradients they never reach for
the long, nearly free modes of a regular arrangement, whose displacements are large and whose
linearised compression is none.

They begin from a common background pressure (Adami, Hu and Adams 2013), which spreads particles
evenly: in disorder particles of density 1 fill more space than evenly spread ones. It acts in
proportion to the way that a particle goes (Skillen, Lind, Stansby and Rogers 2013), since motion is
what upsets an arrangement. docs/method.md, "Position correction", has the measurements.
"""

import math

import taichi as ti

from msph.fluid.particles.particles import Attribute
from msph.fluid.projection.conjugate_gradient import TINY
from msph.fluid.projection.discretisation import Discretisation
from msph.taichi_internals import data_oriented, kernel

ATTRIBUTES = (
    Attribute("position_multiplier", "m^2", "unknown of the position correction", carried=False),
    Attribute("position_correction", "m", "displacement that ends crowding", 3, carried=False),
    Attribute("crowding", "-", "2: corrected first, 1: displaced", integer=True, carried=False),
    Attribute("velocity_exchange", "m/s", "given by neighbours", 3, carried=False),
    Attribute("relative_speed", "m/s", "largest past neighbours and walls", carried=False),
)

# Density excess (-) from which on there are so many rounds of iterations: waves reach the first,
# halves after a split the second. Three for both left up to 1 % in rocking layers, not .5 to .7.
URGENT_ROUNDS = {0.02: 3, 0.06: 4}
# Density excess (-) from which on particles are the middle of a crowd, which has these rounds.
CROWDED = 0.005
# Background pressure, as a density excess (-), and the deficit (-) from which on it is off. It
# takes stiffness against shear: at .0265 water 15 spacings deep sloshes 1 % too slowly.
SPREAD, THIN = 0.014, 0.03
# Way in a step, in spacings, from which on particles spread in full, and the share (-) at rest. In
# full everywhere waves of half a spacing swing 4.9 % too slowly, not 2.9.
BRISK, LEAST = 0.1, 0.3
# Under-relaxation of Jacobi: DAMPING over the number of neighbours, at most MOST_DAMPING. Stable
# below 2/lambda_max, which was .68, .53 and .31 at 27, 57 and 97 neighbours.
DAMPING, MOST_DAMPING = 24.0, 0.5
# Displacement, in spacings, below which there is none to limit.
SMALLEST = 1e-6
# Squared distance [m^2] from which on a direction can be told.
NEAR = 1e-16


@data_oriented
class PositionCorrection:
    """Finds displacements of at most `largest_shift` spacings, and applies them."""

    def __init__(self, shared: Discretisation):
        self.constants, self.contact, self.layers = shared.constants, shared.contact, shared.layers
        self.particles = shared.particles
        self.neighbours, self.density = shared.neighbours, shared.density
        self.operator, self.impulses = shared.operator, shared.impulses
        self.pair_gradient = shared.density.pair_gradient
        self.iterations = 1

    def load(self, iterations: int) -> None:
        """Takes the number of iterations of a scene."""
        self.iterations = iterations
        # Launched on no particles, so that no splash waits for compilation.
        self._find_crowds(0)
        self._part_crowds(0)

    def find(self, dt: float) -> float:
        """Displacements that end crowding; returns the largest density excess (-). dt [s]: the
        step; 0 before time starts, when all spread in full."""
        n = self.particles.count
        largest = self.density.largest_excess
        rounds = max((r for least, r in URGENT_ROUNDS.items() if largest > least), default=1)
        # Only the last round spreads: more iterations would leave less of the spreading.
        if rounds > 1:
            self._find_crowds(n)
            for _ in range((rounds - 1) * self.iterations):
                self._part_crowds(n)
            self._relax(n, dt, 1.0)
        else:
            self._begin(n, dt)
        for _ in range(self.iterations - 1):
            self._relax(n, dt, 0.0)
        return largest

    @kernel
    def _begin(self, n: ti.i32, dt: ti.f32):
        """The first iteration, from q = 0, with the background; see _relax()."""
        p = self.particles
        for i in range(n):
            wanted = self.density.excess(i) + self.background(i, dt)
            p.position_multiplier[i] = self.corrected(i, 0.0, wanted)
        self._displace(n)

    @kernel
    def _find_crowds(self, n: ti.i32):
        """q = 0, u = 0, and the crowding: 2 for particles of an excess above CROWDED and their
        neighbours, 1 for neighbours of those."""
        p = self.particles
        for i in range(n):
            p.position_multiplier[i], p.crowding[i] = 0.0, 0
            p.position_correction[i] = ti.Vector([0.0, 0.0, 0.0])
        # Threads may mark the same particle, all with the same value.
        for i in range(n):
            if self.density.excess(i) > CROWDED:
                p.crowding[i] = 2
                for s in range(self.neighbours.start[i], self.neighbours.mirrors[i]):
                    p.crowding[self.neighbours.index[s]] = 2
        for i in range(n):
            if p.crowding[i] == 2:
                for s in range(self.neighbours.start[i], self.neighbours.mirrors[i]):
                    j = self.neighbours.index[s]
                    if p.crowding[j] == 0:
                        p.crowding[j] = 1

    @kernel
    def _part_crowds(self, n: ti.i32):
        """_relax() of crowds alone, without the background."""
        p = self.particles
        for i in range(n):
            if p.crowding[i] == 2:
                r = self.density.excess(i) + self.operator.divergence(i, p.position_correction)
                p.position_multiplier[i] = self.corrected(i, p.position_multiplier[i], r)
        for i in range(n):
            if p.crowding[i] > 0:
                p.position_correction[i] = self.operator.displacement(i, p.position_multiplier)

    @kernel
    def _relax(self, n: ti.i32, dt: ti.f32, spread: ti.f32):
        """q += omega r/D, not below 0, with r = c - 1 + sum V_j (u_i - u_j).grad W_ij, the
        displacements u in position_correction; `spread` (-) times the background is added to r."""
        p = self.particles
        for i in range(n):
            r = self.density.excess(i) + self.operator.divergence(i, p.position_correction)
            r += spread * self.background(i, dt)
            p.position_multiplier[i] = self.corrected(i, p.position_multiplier[i], r)
        self._displace(n)

    @ti.func
    def _displace(self, n):
        p = self.particles
        for i in range(n):
            p.position_correction[i] = self.operator.displacement(i, p.position_multiplier)

    @ti.func
    def corrected(self, i, q, r):
        """Multiplier of i after q += omega r/D, not below 0; r the compression left by q."""
        return ti.max(
            q + self.constants.relaxation[None] * r / ti.max(self.particles.diagonal[i], TINY), 0.0
        )

    @ti.func
    def background(self, i, dt):
        """The background pressure of particle i as a density excess (-): none at the surface."""
        way = dt * self.particles.v[i].norm() / self.layers.spacing[self.particles.layer[i]]
        share = ti.select(dt > 0.0, ti.math.clamp(way / BRISK, LEAST, 1.0), 1.0)
        return ti.select(self.density.excess(i) > -THIN, share * SPREAD, 0.0)

    def apply(self) -> None:
        """Moves the particles by what find() has found, but not into walls and bodies."""
        self._apply(self.particles.count)
        self.contact.clear_bodies()

    @kernel
    def _apply(self, n: ti.i32):
        """x += position_correction, at most `largest_shift` spacings; lists must be of find().

        A pair that is moved apart to r (1 + a) keeps its angular momentum only if its relative
        velocity shrinks by a; so v_i -= sum a_ij (v_i - v_j), a_ij = -(q_i + q_j) V_j W'/r >= 0,
        which keeps the momentum too, and adds no energy. The same pass finds relative speeds.
        """
        p = self.particles
        for i in range(n):
            change = ti.Vector([0.0, 0.0, 0.0])
            q, v, x = p.position_multiplier[i], p.v[i], p.x[i]
            fastest = self.speed_past_walls(i, x, v) ** 2
            for s in range(self.neighbours.start[i], self.neighbours.mirrors[i]):
                j = self.neighbours.index[s]
                r_ij = x - p.x[j]
                slope = self.pair_gradient[s].dot(r_ij) / ti.max(r_ij.norm_sqr(), NEAR)
                a = slope * (q + p.position_multiplier[j])
                relative = v - p.v[j]
                change += a * relative
                fastest = ti.max(fastest, relative.norm_sqr())
            p.velocity_exchange[i] = change
            p.relative_speed[i] = ti.sqrt(fastest)
            m = self.layers.mass[p.layer[i]]
            self.impulses.record_internal(m, x, change)
            wall = self.operator.wall_displacement(i, p.position_multiplier)
            inner = self.limit(i) * (p.position_correction[i] - wall)
            self.impulses.internal_angular_impulse[None] += m * inner.cross(v + change)
        for i in range(n):
            x, margin = p.x[i] + self.limit(i) * p.position_correction[i], self.contact.margin(i)
            p.x[i] = ti.math.clamp(x, margin, self.constants.size[None] - margin)
            p.v[i] += p.velocity_exchange[i]

    @ti.func
    def speed_past_walls(self, i, x, v):
        """Largest speed [m/s] at which walls within reach of x approach or recede; all of |v| by
        bodies, whose sides may face anywhere."""
        h = self.layers.support[self.particles.layer[i]]
        speed, near = 0.0, self.neighbours.images.walls_near(x, h)
        for k in ti.static(range(3)):
            meets = ((near >> k) | (near >> (k + 3))) & 1
            speed = ti.max(speed, meets * abs(v[k]))
        by_body = self.particles.boundary_gradient[i].norm_sqr() > 0.0
        return ti.select(by_body, v.norm(), speed)

    @ti.func
    def limit(self, i):
        """Share of the correction that is at most `largest_shift` spacings long."""
        d = self.layers.spacing[self.particles.layer[i]]
        length = ti.max(self.particles.position_correction[i].norm(), SMALLEST * d)
        return ti.min(1.0, self.constants.largest_shift[None] * d / length)


def relaxation(widest: float) -> float:
    """Under-relaxation of Jacobi (-), for the largest support over spacing of all layers."""
    return min(MOST_DAMPING, DAMPING / (4.0 / 3.0 * math.pi * widest**3))
