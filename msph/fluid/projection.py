"""The projection method: incompressible, momentum-conserving SPH over layers of any size.

Symmetric kernel W_ij = W(r_ij, (h_i + h_j)/2), so that every pair force is equal and opposite
whatever the masses; walls by the kernel's integral; two pressure solves, one that makes velocities
divergence-free and one that moves particles apart without giving them velocity (after Bender and
Koschier 2015, DFSPH, made conservative for unequal masses).
"""

import math
from dataclasses import dataclass

import taichi as ti

from msph.fluid import kernels, pressure_solve
from msph.fluid.forcing import Forcing, hand_acceleration
from msph.fluid.grid import LayeredGrid
from msph.fluid.layers import Layers, LayerSpec
from msph.fluid.neighbours import NeighbourList
from msph.fluid.obstacles import BEGIN, Walls
from msph.fluid.particles import Attribute, Particles
from msph.fluid.pressure_solve import PressureSolve

ATTRIBUTES = (
    Attribute("density", "kg/m^3", "relative density c times rest density"),
    Attribute("pressure", "Pa", "pressure of the velocity solve"),
    Attribute("crowding", "m^2", "multiplier of the position solve"),
    *pressure_solve.ATTRIBUTES,
)

# Coincident particles have no direction to be pushed in; they are held this far apart, in h.
TOUCHING = 1e-6


@dataclass(frozen=True)
class ProjectionTerms:
    """Constants of the projection method.

    density rho0 [kg/m^3]. cfl: dt <= cfl min d/|v|; longest_step [s] bounds dt for slow water.
    release beta: share of a density excess that becomes velocity (-); the rest is the position
    solve's. tolerance, residual (-) and restart: see PressureSolve; velocity_iterations,
    position_iterations: the most of each. largest_shift: of the position solve, in spacings.
    spray: relative density, walls included, below which no rate of compression can be told (-).
    Counting neighbours instead lets water in edges of the box, which has few, gain energy.
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

    Both solves are one PressureSolve. The position solve displaces by its shifts u; the velocity
    solve gives v += u/dt, and its multiplier is q = dt^2 p/rho0.
    """

    attributes = ATTRIBUTES
    LIST_MARGIN = 0.1  # in supports of the finest layer: the position solve moves within it

    def __init__(
        self,
        walls: Walls,
        layers: Layers,
        grid: LayeredGrid,
        particles: Particles,
        terms: ProjectionTerms,
    ):
        self.walls = walls
        self.layers, self.grid, self.particles = layers, grid, particles
        self.terms = terms
        self.neighbours = NeighbourList(grid, particles, self.reach(terms), self.LIST_MARGIN)
        # What a particle adds to its own density, less its bias.
        self.own = ti.field(ti.f32, shape=layers.count)
        for k, spec in enumerate(layers.specs):
            self.own[k] = spec.volume * kernels.WENDLAND / spec.support**3 * (1.0 - own_bias(spec))
        self.slope = ti.field(ti.f32, shape=self.neighbours.index.shape)
        self.pressure_solve = PressureSolve(
            layers,
            particles,
            self.neighbours,
            self.slope,
            terms.tolerance,
            terms.residual,
            terms.restart,
        )
        self.top_rate = ti.field(ti.f32, shape=())
        self.internal_impulse = ti.Vector.field(3, ti.f32, shape=())
        if walls.moving:
            # What bodies add to dc/dt by their motion [1/s].
            self.inflow = ti.field(ti.f32, shape=particles.capacity)
        self.iterations = {"velocity": 0, "position": 0}

    @staticmethod
    def reach(terms: ProjectionTerms) -> str:
        """Form of the neighbour list."""
        return "mean"

    def reset(self) -> None:
        """Forgets what it knew of the particles: they were replaced."""
        self.internal_impulse[None] = ti.Vector([0.0, 0.0, 0.0])
        self.top_rate[None] = 0.0
        self.grid.invalidate()
        self.grid.refresh()

    def longest_step(self) -> float:
        """Largest time step [s] now: no particle moves farther than cfl of its spacing."""
        # Nor may a body overtake what it pushes.
        rate = max(self.top_rate[None], self.walls.top_speed / self.layers.finest.spacing)
        bound = self.terms.cfl / rate if rate > 0.0 else self.terms.longest_step
        return min(bound, self.terms.longest_step)

    def step(self, dt: float, forcing: Forcing) -> None:
        """Neighbours; positions without crowding; forces; velocities without compression; move."""
        n = self.particles.count
        self.neighbours.refresh()
        self.weigh(n)
        self.aim_at_rest_density(n)
        self.iterations["position"] = self.pressure_solve.run(
            self.particles.crowding, self.terms.position_iterations
        )
        self.displace(n)
        self.weigh(n)
        self.push(n, dt, *forcing.arguments())
        self.aim_at_no_compression(n, dt)
        self.scale(n, dt * dt / self.terms.density)
        self.iterations["velocity"] = self.pressure_solve.run(
            self.particles.pressure, self.terms.velocity_iterations
        )
        self.scale(n, self.terms.density / (dt * dt))
        self.move(n, dt)
        self.neighbours.moved(math.inf)
        self.grid.invalidate()

    @ti.kernel
    def weigh(self, n: ti.i32):
        """c_i = sum V_j W_ij + lambda_i, g_i, D_i = |g_i|^2 + V_i sum V_j |grad W_ij|^2, slopes."""
        for i in range(n):
            layer = self.particles.layer[i]
            x, h_i = self.particles.x[i], self.layers.support[layer]
            wall = self.walls.share(x, layer, h_i)
            if ti.static(self.walls.moving):
                self.inflow[i] = -wall[4]
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
            rate = self.pressure_solve.divergence(i, self.particles.v)
            if ti.static(self.walls.moving):
                rate += self.inflow[i]
            c = self.particles.density[i] / self.terms.density - 1.0
            if 1.0 + c < self.terms.spray:
                rate = ti.min(rate, 0.0)
            self.particles.source[i] = dt * rate + ti.select(c < 0.0, c, self.terms.release * c)

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
            u *= ti.min(1.0, self.terms.largest_shift * d / ti.max(u.norm(), TOUCHING * d))
            x = self.particles.x[i] + u
            self.particles.x[i] = self.walls.keep(x, BEGIN)

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
        """v = v* + u/dt, x += dt v; what would leave is stopped at its wall."""
        self.top_rate[None] = 0.0
        for i in range(n):
            layer = self.particles.layer[i]
            d = self.layers.spacing[layer]
            u = self.particles.shift[i]
            v = self.particles.v[i] + u / dt
            q = self.particles.pressure[i] * dt * dt / self.terms.density
            inner = (u + q * self.particles.wall[i]) / dt
            if ti.static(self.walls.moving):
                # Force of the bodies on the particle times their velocity.
                self.walls.work[None] += self.layers.mass[layer] * q / dt * self.inflow[i]
            self.internal_impulse[None] += self.layers.mass[layer] * inner
            x, v = self.walls.guard(self.particles.x[i] + dt * v, v, self.terms.restitution)
            self.particles.x[i] = x
            self.particles.v[i] = v
            ti.atomic_max(self.top_rate[None], v.norm() / d)
