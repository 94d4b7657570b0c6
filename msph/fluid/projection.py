"""The projection method: incompressible, momentum-conserving SPH over layers of any size.

Symmetric kernel W_ij = W(r_ij, (h_i + h_j)/2), so that every pair force is equal and opposite
whatever the masses; walls by the kernel's integral; two pressure solves, one that makes velocities
divergence-free and one that moves particles apart without giving them velocity (after Bender and
Koschier 2015, DFSPH, made conservative for unequal masses).
"""

import math
from dataclasses import dataclass

import taichi as ti

from msph.fluid import kernels
from msph.fluid.forcing import Forcing, hand_acceleration
from msph.fluid.grid import LayeredGrid
from msph.fluid.layers import Layers, LayerSpec
from msph.fluid.neighbours import NeighbourList
from msph.fluid.particles import Attribute, Particles
from msph.fluid.walls import wall_share

ATTRIBUTES = (
    Attribute("density", "kg/m^3", "relative density c times rest density"),
    Attribute("pressure", "Pa", "pressure of the velocity solve"),
    Attribute("crowding", "m^2", "multiplier of the position solve"),
    Attribute("shift", "m", "displacement by a solve", width=3, carried=False),
    Attribute("source", "-", "compression that a solve must undo", carried=False),
    Attribute("gradient", "1/m", "sum V_j grad W_ij and the walls' part", width=3, carried=False),
    Attribute("wall", "1/m", "gradient of the walls' part of c", width=3, carried=False),
    Attribute("diagonal", "1/m^2", "diagonal of the solves' operator", carried=False),
    Attribute("residual", "-", "compression left by a solve", carried=False),
    Attribute("direction", "m^2", "search direction of a solve", carried=False),
    Attribute("response", "-", "compression that the direction undoes", carried=False),
)

# Coincident particles have no direction to be pushed in; they are held this far apart, in h.
TOUCHING = 1e-6
# Keeps divisions by what may vanish finite; far below any diagonal [1/m^2] or curvature met.
TINY = 1e-30


@dataclass(frozen=True)
class ProjectionTerms:
    """Constants of the projection method.

    density rho0 [kg/m^3]. cfl: dt <= cfl min d/|v|; longest_step [s] bounds dt for slow water.
    release beta: share of a density excess that becomes velocity (-); the rest is the position
    solve's. Both solves stop when no particle's compression exceeds `tolerance` times the largest
    that the solve began with, nor `residual` (-), or after velocity_iterations,
    position_iterations. A mean would not do: while a deep column falls only its lowest particles
    are compressed, and under-converged it explodes. restart: iterations between new choices of the
    particles that push. largest_shift: of the position solve, in spacings. spray: relative density,
    walls included, below which no rate of compression can be told (-). Counting neighbours instead
    lets water in edges of the box, which has few, gain energy.
    """

    density: float = 1000.0
    restitution: float = 0.0
    cfl: float = 0.4
    longest_step: float = 1.0 / 120.0
    release: float = 0.2
    tolerance: float = 0.02
    residual: float = 5e-4
    restart: int = 12
    velocity_iterations: int = 120
    position_iterations: int = 12
    largest_shift: float = 0.25
    spray: float = 0.4


def own_bias(spec: LayerSpec) -> float:
    """Share by which a particle overrates itself in its density (-).

    The sum over a Wendland C2 kernel's N neighbours is too large because the particle sits in the
    kernel's peak, by 0.0294 (N/100)^-0.977 of its own part (Dehnen & Aly 2012, eq. 18 and 19).
    Uncorrected, water at 33 neighbours stands 4 % too high.
    """
    neighbours = 4.0 / 3.0 * math.pi * spec.smoothing**3
    return 0.0294 * (neighbours / 100.0) ** -0.977


@ti.data_oriented
class Projection:
    """One solver over the particles of all layers.

    A solve finds multipliers q >= 0 [m^2] and displacements
    u_i = -(q_i g_i + sum V_j q_j grad W_ij) [m], g_i = sum V_j grad W_ij + grad lambda_i, so that
    source_i + sum V_j (u_i - u_j).grad W_ij + u_i.grad lambda_i <= 0. Divergence and gradient are
    adjoint, so the operator is symmetric and positive under the weights V. The velocity solve
    gives v += u/dt, its q is dt^2 p/rho0.
    """

    attributes = ATTRIBUTES
    LIST_MARGIN = 0.1  # in supports of the finest layer: the position solve moves within it

    def __init__(
        self,
        size: tuple[float, float, float],
        layers: Layers,
        grid: LayeredGrid,
        particles: Particles,
        terms: ProjectionTerms,
    ):
        self.size = ti.Vector(list(size))
        self.layers, self.grid, self.particles = layers, grid, particles
        self.terms = terms
        self.neighbours = NeighbourList(grid, particles, self.reach(terms), self.LIST_MARGIN)
        # What a particle adds to its own density, less its bias.
        self.own = ti.field(ti.f32, shape=layers.count)
        for k, spec in enumerate(layers.specs):
            self.own[k] = spec.volume * kernels.WENDLAND / spec.support**3 * (1.0 - own_bias(spec))
        self.slope = ti.field(ti.f32, shape=self.neighbours.index.shape)
        self.start_max = ti.field(ti.f32, shape=())
        self.descent = ti.field(ti.f32, shape=())
        self.last_descent = ti.field(ti.f32, shape=())
        self.curvature = ti.field(ti.f32, shape=())
        self.error_max = ti.field(ti.f32, shape=())
        self.top_rate = ti.field(ti.f32, shape=())
        self.internal_impulse = ti.Vector.field(3, ti.f32, shape=())
        self.iterations = {"velocity": 0, "position": 0}
        self.binned = False

    @staticmethod
    def reach(terms: ProjectionTerms) -> str:
        """Form of the neighbour list."""
        return "mean"

    def reset(self) -> None:
        """Forgets what it knew of the particles: they were replaced."""
        self.internal_impulse[None] = ti.Vector([0.0, 0.0, 0.0])
        self.top_rate[None] = 0.0
        self.binned = False
        self.bin()

    def longest_step(self) -> float:
        """Largest time step [s] now: no particle moves farther than cfl of its spacing."""
        rate = self.top_rate[None]
        bound = self.terms.cfl / rate if rate > 0.0 else self.terms.longest_step
        return min(bound, self.terms.longest_step)

    def bin(self) -> None:
        """Sorts the particles into the grid where they have moved since the last time."""
        if not self.binned:
            self.grid.build()
            self.neighbours.invalidate()
            self.binned = True

    def find_neighbours(self) -> None:
        if self.neighbours.stale:
            self.bin()
            self.neighbours.find()

    def step(self, dt: float, forcing: Forcing) -> None:
        """Neighbours; positions without crowding; forces; velocities without compression; move."""
        n, hand = self.particles.count, forcing.hand
        self.find_neighbours()
        self.weigh(n)
        self.aim_at_rest_density(n)
        self.iterations["position"] = self.solve(
            self.particles.crowding, self.terms.position_iterations
        )
        self.displace(n)
        self.weigh(n)
        self.push(
            n,
            dt,
            ti.Vector(forcing.gravity),
            ti.Vector(hand.position),
            ti.Vector(hand.velocity),
            hand.radius,
            hand.grip,
        )
        self.aim_at_no_compression(n, dt)
        self.scale(n, dt * dt / self.terms.density)
        self.iterations["velocity"] = self.solve(
            self.particles.pressure, self.terms.velocity_iterations
        )
        self.scale(n, self.terms.density / (dt * dt))
        self.move(n, dt)
        self.neighbours.invalidate()
        self.binned = False

    def solve(self, multiplier, most: int) -> int:
        """Projected conjugate gradients from the last step's multipliers; the iterations taken.

        Within a round the particles that push are fixed: those with q > 0 or compressed. A round
        begins anew from the true residual, so what clamping at q = 0 breaks is mended there.
        """
        n, p = self.particles.count, self.particles
        taken = 0
        while taken < most:
            self.find_shifts(n, multiplier)
            self.begin(n, multiplier, taken == 0)
            bound = max(self.terms.tolerance * self.start_max[None], self.terms.residual)
            if self.error_max[None] < bound:
                break
            for k in range(min(self.terms.restart, most - taken)):
                self.find_shifts(n, p.direction)
                self.respond(n)
                self.descend(n, multiplier)
                self.turn(n)
                taken += 1
                if k % 3 == 2 and self.error_max[None] < 0.5 * bound:
                    break
        self.find_shifts(n, multiplier)
        return taken

    @ti.kernel
    def weigh(self, n: ti.i32):
        """c_i = sum V_j W_ij + lambda_i, g_i, D_i = |g_i|^2 + V_i sum V_j |grad W_ij|^2, slopes."""
        for i in range(n):
            layer = self.particles.layer[i]
            x, h_i = self.particles.x[i], self.layers.support[layer]
            wall = wall_share(x, h_i, self.size)
            c = self.own[layer] + wall[0]
            g = ti.Vector([wall[1], wall[2], wall[3]])
            squares = 0.0
            for s in range(self.neighbours.start[i], self.neighbours.end[i]):
                j = self.neighbours.index[s]
                other = self.particles.layer[j]
                v_j, h = self.layers.volume[other], 0.5 * (h_i + self.layers.support[other])
                r_ij = x - self.particles.x[j]
                r = r_ij.norm()
                c += v_j * kernels.wendland(r, h)
                slope = kernels.wendland_slope(r, h)
                # Stored with the neighbour's volume and over r: grad W_ij = slope_s r_ij / V_j.
                self.slope[s] = v_j * slope / ti.max(r, TOUCHING * h)
                g += self.slope[s] * r_ij
                squares += v_j * slope * slope
            self.particles.density[i] = c * self.terms.density
            self.particles.gradient[i] = g
            self.particles.wall[i] = ti.Vector([wall[1], wall[2], wall[3]])
            self.particles.diagonal[i] = g.norm_sqr() + self.layers.volume[layer] * squares

    @ti.kernel
    def aim_at_rest_density(self, n: ti.i32):
        """source_i = c_i - 1 of the position solve."""
        for i in range(n):
            self.particles.source[i] = self.particles.density[i] / self.terms.density - 1.0

    @ti.kernel
    def aim_at_no_compression(self, n: ti.i32, dt: ti.f32):
        """source_i = dt dc/dt + (c_i - 1 if c_i < 1, else beta (c_i - 1)) of the velocity solve."""
        for i in range(n):
            v = self.particles.v[i]
            rate = v.dot(self.particles.wall[i])
            for s in range(self.neighbours.start[i], self.neighbours.end[i]):
                j = self.neighbours.index[s]
                r_ij = self.particles.x[i] - self.particles.x[j]
                rate += self.slope[s] * (v - self.particles.v[j]).dot(r_ij)
            c = self.particles.density[i] / self.terms.density - 1.0
            if 1.0 + c < self.terms.spray:
                rate = ti.min(rate, 0.0)
            self.particles.source[i] = dt * rate + ti.select(c < 0.0, c, self.terms.release * c)

    @ti.kernel
    def find_shifts(self, n: ti.i32, q: ti.template()):
        """u_i = -(q_i g_i + sum V_j q_j grad W_ij) [m]."""
        for i in range(n):
            u = -q[i] * self.particles.gradient[i]
            for s in range(self.neighbours.start[i], self.neighbours.end[i]):
                j = self.neighbours.index[s]
                r_ij = self.particles.x[i] - self.particles.x[j]
                u -= q[j] * self.slope[s] * r_ij
            self.particles.shift[i] = u

    @ti.func
    def divergence(self, i):
        """sum V_j (u_i - u_j).grad W_ij + u_i.grad lambda_i of the shifts u (-)."""
        u = self.particles.shift[i]
        found = u.dot(self.particles.wall[i])
        for s in range(self.neighbours.start[i], self.neighbours.end[i]):
            j = self.neighbours.index[s]
            r_ij = self.particles.x[i] - self.particles.x[j]
            found += self.slope[s] * (u - self.particles.shift[j]).dot(r_ij)
        return found

    @ti.kernel
    def begin(self, n: ti.i32, q: ti.template(), first: ti.i32):
        """r = source - A q where particles push, 0 elsewhere; first direction r/D."""
        self.descent[None] = 0.0
        self.error_max[None] = 0.0
        if first == 1:
            self.start_max[None] = 0.0
        for i in range(n):
            r = self.particles.source[i] + self.divergence(i)
            d = ti.max(self.particles.diagonal[i], TINY)
            # Compression left, and also expansion where a multiplier still pushes: both are error.
            ti.atomic_max(self.error_max[None], abs(ti.max(q[i] + r / d, 0.0) - q[i]) * d)
            ti.atomic_max(self.start_max[None], self.particles.source[i])
            if q[i] <= 0.0 and r <= 0.0:
                r = 0.0
            self.particles.residual[i] = r
            self.particles.direction[i] = r / d
            self.descent[None] += self.layers.volume[self.particles.layer[i]] * r * r / d

    @ti.kernel
    def respond(self, n: ti.i32):
        """A p of the direction p, and p.A p weighed by V."""
        self.curvature[None] = 0.0
        for i in range(n):
            response = -self.divergence(i)
            self.particles.response[i] = response
            volume = self.layers.volume[self.particles.layer[i]]
            self.curvature[None] += volume * self.particles.direction[i] * response

    @ti.kernel
    def descend(self, n: ti.i32, q: ti.template()):
        """q += alpha p, not below 0; r -= alpha A p where particles push."""
        self.last_descent[None] = self.descent[None]
        self.descent[None] = 0.0
        self.error_max[None] = 0.0
        for i in range(n):
            alpha = self.last_descent[None] / ti.max(self.curvature[None], TINY)
            d = ti.max(self.particles.diagonal[i], TINY)
            p, r = self.particles.direction[i], self.particles.residual[i]
            if p != 0.0 or r != 0.0:
                r -= alpha * self.particles.response[i]
                if q[i] + alpha * p < 0.0:
                    # It pushes no more, and is out of this round.
                    r = 0.0
                    self.particles.direction[i] = 0.0
                self.particles.residual[i] = r
            q[i] = ti.max(q[i] + alpha * p, 0.0)
            ti.atomic_max(self.error_max[None], abs(ti.max(q[i] + r / d, 0.0) - q[i]) * d)
            self.descent[None] += self.layers.volume[self.particles.layer[i]] * r * r / d

    @ti.kernel
    def turn(self, n: ti.i32):
        """p = r/D + beta p."""
        for i in range(n):
            beta = self.descent[None] / ti.max(self.last_descent[None], TINY)
            d = ti.max(self.particles.diagonal[i], TINY)
            self.particles.direction[i] = (
                self.particles.residual[i] / d + beta * self.particles.direction[i]
            )

    @ti.kernel
    def scale(self, n: ti.i32, factor: ti.f32):
        """Between pressure [Pa] and the multiplier q = dt^2 p/rho0 [m^2]."""
        for i in range(n):
            self.particles.pressure[i] *= factor

    @ti.kernel
    def displace(self, n: ti.i32):
        """x += u of the position solve, at most `largest_shift` spacings; velocities stay."""
        for i in range(n):
            d = self.layers.spacing[self.particles.layer[i]]
            u = self.particles.shift[i]
            u *= ti.min(1.0, self.terms.largest_shift * d / ti.max(u.norm(), 1e-12))
            x = self.particles.x[i] + u
            self.particles.x[i] = ti.math.clamp(x, 0.0, self.size)

    @ti.kernel
    def push(
        self,
        n: ti.i32,
        dt: ti.f32,
        gravity: ti.math.vec3,
        hand_x: ti.math.vec3,
        hand_v: ti.math.vec3,
        hand_radius: ti.f32,
        hand_grip: ti.f32,
    ):
        """v* = v + dt (g + what the hand gives)."""
        for i in range(n):
            v = self.particles.v[i]
            a = gravity
            a += hand_acceleration(
                self.particles.x[i], v, dt, hand_x, hand_v, hand_radius, hand_grip
            )
            self.particles.v[i] = v + dt * a

    @ti.kernel
    def move(self, n: ti.i32, dt: ti.f32):
        """v = v* + u/dt, x += dt v; what would leave the box is stopped at its wall."""
        self.top_rate[None] = 0.0
        for i in range(n):
            layer = self.particles.layer[i]
            d = self.layers.spacing[layer]
            u = self.particles.shift[i]
            v = self.particles.v[i] + u / dt
            q = self.particles.pressure[i] * dt * dt / self.terms.density
            inner = (u + q * self.particles.wall[i]) / dt
            self.internal_impulse[None] += self.layers.mass[layer] * inner
            x = self.particles.x[i] + dt * v
            for k in ti.static(range(3)):
                if x[k] < 0.0 or x[k] > self.size[k]:
                    x[k] = ti.math.clamp(x[k], 0.0, self.size[k])
                    v[k] = -self.terms.restitution * v[k]
            self.particles.x[i] = x
            self.particles.v[i] = v
            ti.atomic_max(self.top_rate[None], v.norm() / d)
