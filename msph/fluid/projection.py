"""The projection method: incompressible, momentum-conserving SPH over layers of any size.

Symmetric kernel W_ij = W(r_ij, (h_i + h_j)/2), so that every pair force is equal and opposite
whatever the masses; walls are mirrors; two pressure solves, one that makes velocities
divergence-free and one that moves particles apart without giving them velocity (after Bender and
Koschier 2015, DFSPH, made conservative for unequal masses).
"""

import math
from dataclasses import dataclass

import taichi as ti

from msph.fluid import adaptation, kernels, pressure_solve, tension, viscosity
from msph.fluid.accounts import Accounts
from msph.fluid.adaptation import Adaptation, AdaptationTerms
from msph.fluid.forcing import Forcing, hand_acceleration
from msph.fluid.grid import LayeredGrid
from msph.fluid.images import Images
from msph.fluid.layers import Layers, LayerSpec
from msph.fluid.neighbours import NeighbourList
from msph.fluid.obstacles import BEGIN, Walls
from msph.fluid.particles import Attribute, Particles
from msph.fluid.pressure_solve import WALL_ATTRIBUTES, PressureSolve
from msph.fluid.tension import Tension
from msph.fluid.viscosity import Viscosity
from msph.fluid.xsph import Xsph

_ATTRIBUTES = (
    Attribute("density", "kg/m^3", "relative density c times rest density"),
    Attribute("pressure", "Pa", "pressure of the velocity solve"),
    Attribute("crowding", "m^2", "multiplier of the position solve", carried=False),
    Attribute("exchange", "m/s", "velocity given by neighbours", width=3, carried=False),
    *pressure_solve.ATTRIBUTES,
)

# Rounds of the position solve before time starts, at most.
ARRANGING = 100
# Excess of density that needs no position solve.
LOOSE = 1e-3
# Excess of density, as halves have it after a split, from which on the position solve takes more
# rounds.
URGENT, URGENT_ROUNDS = 0.02, 3
# Least distance to a wall, in spacings; the golden section spreads multiples of it evenly.
NEAREST, GOLDEN = 0.05, 0.6180340
# How much stricter, and longer, the first solve of a run is, and how much shorter its step.
FIRST_CARE = 10
# Deficit of density up to which a gap beside a merger is not yet to be closed.
SMALL_GAP = 0.1
# Spray, which meets nothing, may move so many times farther in a step.
SPRAY_LEAP = 2.5
# Coincident particles have no direction to be pushed in; they are held this far apart, in h.
TOUCHING = 1e-6


# A particle's density, the sum V_j grad W_ij [1/m], and sum V_j |grad W_ij|^2 [1/m^5].
Sums = ti.types.struct(c=ti.f32, g=ti.math.vec3, squares=ti.f32)


@dataclass(frozen=True)
class ProjectionTerms:
    """Constants of the projection method.

    density rho0 [kg/m^3]. The time step is bounded by cfl (-), dt <= cfl d/|v|, by pressure_cfl
    (-), dt <= pressure_cfl d/sqrt(p/rho0), and by longest_step [s] for slow, shallow water.
    release [s]: time in which a density excess may become velocity; the rest is for the position
    solve, of position_iterations, at most largest_shift spacings a step. tolerance (-): share of
    the pressure's displacements that the velocity solve may leave, in velocity_iterations at most.
    spray: relative density below which no rate of compression can be told (-). Counting
    neighbours instead lets water in edges of the box, which has few, gain energy. viscosity
    [Pa s], slip at walls, tension [N/m] of the surface and xsph (-): 0 is off. adaptation: None
    where every particle keeps its layer.
    """

    density: float = 1000.0
    restitution: float = 0.0
    cfl: float = 0.4
    pressure_cfl: float = 0.7
    longest_step: float = 1.0 / 60.0
    release: float = 0.4
    tolerance: float = 0.05
    velocity_iterations: int = 120
    position_iterations: int = 4
    largest_shift: float = 0.25
    spray: float = 0.4
    viscosity: float = 0.0
    slip: bool = True
    tension: float = 0.0
    xsph: float = 0.0
    adaptation: AdaptationTerms | None = None


def own_bias(spec: LayerSpec) -> float:
    """Share by which a particle overrates itself in its density (-).

    The sum over a Wendland C2 kernel's N neighbours is too large because the particle sits in the
    kernel's peak, by 0.0294 (N/100)^-0.977 of its own part (Dehnen & Aly 2012, eq. 18 and 19).
    Uncorrected, water at 33 neighbours stands 4 % too high.
    """
    neighbours = 4.0 / 3.0 * math.pi * spec.smoothing**3
    return 0.0294 * (neighbours / 100.0) ** -0.977


@ti.data_oriented
class Projection(Accounts):
    """One solver over the particles of all layers.

    Both solves are one PressureSolve. The position solve displaces by its shifts u; the velocity
    solve gives v += u/dt, and its multiplier is q = dt^2 p/rho0.
    """

    LIST_MARGIN = 0.1  # in supports of the finest layer: the position solve moves within it

    def __init__(
        self,
        walls: Walls,
        layers: Layers,
        grid: LayeredGrid,
        particles: Particles,
        terms: ProjectionTerms,
    ):
        super().__init__()
        self.walls = walls
        self.layers, self.grid, self.particles = layers, grid, particles
        self.terms = terms
        self.images = Images(walls.box)
        self.neighbours = NeighbourList(
            grid, particles, self.reach(terms), self.LIST_MARGIN, self.images
        )
        # What a particle adds to its own density, less its bias.
        self.own = ti.field(ti.f32, shape=layers.count)
        for k, spec in enumerate(layers.specs):
            self.own[k] = spec.volume * kernels.WENDLAND / spec.support**3 * (1.0 - own_bias(spec))
        self.slope = ti.field(ti.f32, shape=self.neighbours.index.shape)
        self.pressure_solve = PressureSolve(
            layers, particles, self.neighbours, self.slope, walls.count > 0
        )
        self.viscosity = self.tension = self.xsph = None
        if terms.viscosity:
            self.viscosity = Viscosity(
                layers,
                particles,
                self.neighbours,
                self.pressure_solve,
                terms.viscosity,
                terms.density,
                terms.slip,
            )
        if terms.tension:
            self.tension = Tension(
                layers, particles, self.neighbours, self.slope, terms.tension, terms.density
            )
        if terms.xsph:
            self.xsph = Xsph(layers, particles, self.neighbours, terms.xsph)
        self.most_crowded = ti.field(ti.f32, shape=())
        self.top_rate = ti.field(ti.f32, shape=())
        self.adaptation = None
        if terms.adaptation:
            self.adaptation = Adaptation(
                walls, layers, particles, self.neighbours, self.merge_loss, terms.adaptation
            )
        self.adaptive = self.adaptation is not None
        if walls.moving:
            # What bodies add to dc/dt by their motion [1/s].
            self.inflow = ti.field(ti.f32, shape=particles.capacity)
        self.iterations, self.first = 0, True

    @staticmethod
    def attributes(terms: ProjectionTerms, bodies: bool = False) -> tuple[Attribute, ...]:
        """What each particle has, beyond the core, among bodies or not."""
        return (
            _ATTRIBUTES
            + (viscosity.ATTRIBUTES if terms.viscosity else ())
            + (tension.ATTRIBUTES if terms.tension else ())
            + (adaptation.ATTRIBUTES if terms.adaptation else ())
            + (WALL_ATTRIBUTES if bodies else ())
        )

    @staticmethod
    def reach(terms: ProjectionTerms) -> str:
        """Form of the neighbour list."""
        return "mean"

    def reset(self) -> None:
        """Forgets what it knew of the particles: they were replaced."""
        self.clear_accounts()
        self.top_rate[None] = 0.0
        self.first = True
        if self.adaptation:
            self.adaptation.reset()
        self.grid.invalidate()
        self.grid.refresh()

    def arrange(self) -> None:
        """Gives each depth its layer, and moves particles apart that the scene placed too near:
        bodies of water that touch have lattices that do not fit. At time zero it costs no energy.
        """
        unchanged = 0
        for _ in range(ARRANGING):
            crowded = self.separate(self.particles.count)
            self.disturb()
            if self.adaptation:
                unchanged = 0 if self.adaptation.run(budget=1.0) else unchanged + 1
            settled = not self.adaptation or unchanged > self.adaptation.terms.settle
            if settled and not crowded:
                break
        self.clear_accounts()

    def disturb(self) -> None:
        """Tells grid and list that particles moved."""
        self.neighbours.moved(math.inf)
        self.grid.invalidate()

    def longest_step(self) -> float:
        """Largest time step [s] now.

        No particle moves farther than cfl of its spacing. And forces are constant within a step,
        while an arrangement under the pressure p swings at up to about 2 sqrt(p/rho0)/d: longer
        steps make deep fine water boil and collapse, however well each step's pressure converges.
        60 sheets were still at pressure_cfl = .7 and collapsed at 1.4.
        """
        # Nor may a body overtake what it pushes.
        body = self.walls.top_speed / (self.terms.cfl * self.layers.finest.spacing)
        rate = max(self.top_rate[None], body)
        bound = 1.0 / rate if rate > 0.0 else self.terms.longest_step
        longest = min(bound, self.terms.longest_step)
        if self.tension:
            longest = min(longest, self.tension.longest_step)
        # Before the first solve no pressure is known.
        return longest / FIRST_CARE if self.first else longest

    def step(self, dt: float, forcing: Forcing) -> None:
        """Neighbours; positions without crowding; forces; velocities without compression; move."""
        n = self.particles.count
        if self.separate(n):
            self.weigh(n)
        if self.xsph:
            self.xsph.run(n)
        self.push(n, dt, *forcing.arguments())
        if self.tension:
            self.tension.run(n, dt)
        if self.viscosity:
            self.viscosity.run(n, dt)
        self.aim_at_no_compression(n, dt)
        self.scale(n, dt * dt / self.terms.density)
        # The first solve knows no pressure to start from, and what it leaves would fall.
        care = FIRST_CARE if self.first else 1
        self.iterations = self.pressure_solve.converge(
            self.particles.pressure,
            self.terms.tolerance / care,
            care * self.terms.velocity_iterations,
        )
        self.first = False
        self.move(n, dt)
        self.scale(n, self.terms.density / (dt * dt))
        self.disturb()
        if self.adaptation and self.adaptation.due():
            self.adaptation.run()

    def separate(self, n: int) -> bool:
        """The position solve: displaces particles where they are crowded, and says whether any
        were."""
        self.neighbours.refresh()
        self.weigh(n)
        self.aim_at_rest_density(n)
        crowded = self.most_crowded[None]
        if crowded < LOOSE:
            return False
        rounds = URGENT_ROUNDS if crowded > URGENT else 1
        iterations = rounds * self.terms.position_iterations
        self.pressure_solve.relax(self.particles.crowding, iterations)
        self.displace(n)
        return True

    @ti.kernel
    def weigh(self, n: ti.i32):
        """c_i = sum V_j W_ij, g_i = sum V_j grad W_ij, D_i = |g_i|^2 + V_i sum V_j |grad W_ij|^2.

        Sums over neighbours and images; a particle's own images move with it, twice as fast.
        """
        for i in range(n):
            layer = self.particles.layer[i]
            x, h_i = self.particles.x[i], self.layers.support[layer]
            total = Sums(c=self.own[layer])
            if ti.static(self.walls.count > 0):
                wall = self.walls.share(x, layer, h_i)
                total.c += wall[0]
                total.g = ti.Vector([wall[1], wall[2], wall[3]])
                self.particles.wall[i] = total.g
                if ti.static(self.walls.moving):
                    self.inflow[i] = -wall[4]
            for s in range(self.neighbours.start[i], self.neighbours.mirrors[i]):
                j = self.neighbours.index[s]
                self.weigh_pair(s, h_i, j, x - self.particles.x[j], total)
            mirrored = ti.Vector([0.0, 0.0, 0.0])
            for s in range(self.neighbours.mirrors[i], self.neighbours.end[i]):
                j, bits = self.images.read(self.neighbours.index[s])
                r_ij = x - self.images.point(x, self.particles.x[j], bits)
                self.weigh_pair(s, h_i, j, r_ij, total)
                mirrored += ti.select(j == i, 1.0, 0.0) * self.slope[s] * r_ij
            g, volume = total.g, self.layers.volume[layer]
            self.particles.density[i] = total.c * self.terms.density
            self.particles.gradient[i] = g
            self.particles.diagonal[i] = (g + mirrored).norm_sqr() + volume * total.squares

    @ti.func
    def weigh_pair(self, s, h_i, j, r_ij, total: ti.template()):
        """Adds neighbour j to the sums of the Wendland C2 kernel, and stores its slope_s."""
        other = self.particles.layer[j]
        v_j, per_h = self.layers.volume[other], 2.0 / (h_i + self.layers.support[other])
        q = ti.min(r_ij.norm() * per_h, 1.0)
        u = 1.0 - q
        peak = v_j * kernels.WENDLAND * (per_h * per_h * per_h) * (u * u * u)
        total.c += peak * u * (1.0 + 4.0 * q)
        # dW/dr over r: grad W_ij = slope_s r_ij / V_j, without a pole at r = 0.
        slope = -20.0 * peak * (per_h * per_h)
        self.slope[s] = slope
        total.g += slope * r_ij
        total.squares += slope * slope / v_j * r_ij.norm_sqr()

    @ti.kernel
    def aim_at_rest_density(self, n: ti.i32):
        """source_i = c_i - 1 of the position solve, which starts from nothing."""
        self.most_crowded[None] = -1.0
        for i in range(n):
            excess = self.particles.density[i] / self.terms.density - 1.0
            self.particles.source[i] = excess
            self.particles.crowding[i] = 0.0
            ti.atomic_max(self.most_crowded[None], excess)

    @ti.kernel
    def aim_at_no_compression(self, n: ti.i32, dt: ti.f32):
        """source_i = dt dc/dt + (c_i - 1 if c_i < 1, else (c_i - 1) dt/release) of the velocity
        solve."""
        for i in range(n):
            rate = self.pressure_solve.divergence(i, self.particles.v)
            if ti.static(self.walls.moving):
                rate += self.inflow[i]
            c = self.particles.density[i] / self.terms.density - 1.0
            if 1.0 + c < self.terms.spray:
                rate = ti.min(rate, 0.0)
            wanted = ti.select(c < 0.0, c, ti.min(1.0, dt / self.terms.release) * c)
            if ti.static(self.adaptive):
                # Halves are crowded, and mergers leave gaps, until the position solve has met them.
                wanted = ti.select(self.particles.settling[i] > 0 and c > -SMALL_GAP, 0.0, wanted)
            self.particles.source[i] = dt * rate + wanted

    @ti.kernel
    def scale(self, n: ti.i32, factor: ti.f32):
        """Between pressure [Pa] and the multiplier q = dt^2 p/rho0 [m^2]."""
        for i in range(n):
            self.particles.pressure[i] *= factor

    @ti.kernel
    def displace(self, n: ti.i32):
        """x += u of the position solve, at most `largest_shift` spacings.

        A pair that is moved apart to r (1 + a) keeps its angular momentum only if its relative
        velocity shrinks by a; so v_i -= sum a_ij (v_i - v_j), a_ij = -(q_i + q_j) V_j W'/r >= 0,
        which keeps the momentum too, and adds no energy.
        """
        for i in range(n):
            change = ti.Vector([0.0, 0.0, 0.0])
            q, v = self.particles.crowding[i], self.particles.v[i]
            for s in range(self.neighbours.start[i], self.neighbours.mirrors[i]):
                j = self.neighbours.index[s]
                a = self.slope[s] * (q + self.particles.crowding[j])
                change += a * (v - self.particles.v[j])
            self.particles.exchange[i] = change
            # Booked here, where all are still in the places that the solve knew.
            m = self.layers.mass[self.particles.layer[i]]
            self.book_internal(m, self.particles.x[i], change)
            wall = self.pressure_solve.wall_shift(i, self.particles.crowding)
            inner = self.limit(i) * (self.particles.shift[i] - wall)
            self.internal_angular_impulse[None] += m * inner.cross(v + change)
        for i in range(n):
            x = self.particles.x[i] + self.limit(i) * self.particles.shift[i]
            self.particles.x[i] = self.walls.keep(x, BEGIN, self.margin(i))
            self.particles.v[i] += self.particles.exchange[i]

    @ti.func
    def limit(self, i):
        """Share of a shift that is at most `largest_shift` spacings long."""
        d = self.layers.spacing[self.particles.layer[i]]
        length = ti.max(self.particles.shift[i].norm(), TOUCHING * d)
        return ti.min(1.0, self.terms.largest_shift * d / length)

    @ti.func
    def margin(self, i):
        """Distance [m] from walls at which particle i is stopped: each at its own, since what lies
        in one point cannot part again, and what lies on a wall is not repelled by its image."""
        share = GOLDEN * ti.cast(self.particles.id[i] & 1023, ti.f32)
        d = self.layers.spacing[self.particles.layer[i]]
        return NEAREST * (1.0 + share - ti.floor(share)) * d

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
        """v* = v + dt (g + what the hand gives + what gravity adds to the walls' pressures)."""
        for i in range(n):
            m = self.layers.mass[self.particles.layer[i]]
            x, v, lift = self.particles.x[i], self.particles.v[i], self.image_lift(i, gravity)
            hand = hand_acceleration(x, v, dt, hand_x, hand_v, hand_radius, hand_grip)
            self.book_hand(m, v, dt, hand, gravity + lift)
            self.wall_impulse[None] += m * dt * lift
            self.particles.v[i] = v + dt * (gravity + lift + hand)

    @ti.func
    def image_lift(self, i, gravity):
        """Acceleration [m/s^2] by what images have more pressure than their particles.

        No flow crosses a wall, so there dp/dn = rho g.n: behind a floor the pressure goes on
        rising. At most the particle's own, so that water that only passes by is not lifted.
        Without it the lowest sheet bears half a sheet's weight too much.
        """
        x, lift = self.particles.x[i], ti.Vector([0.0, 0.0, 0.0])
        for s in range(self.neighbours.mirrors[i], self.neighbours.end[i]):
            j, bits = self.images.read(self.neighbours.index[s])
            x_j = self.particles.x[j]
            seen = self.images.point(x, x_j, bits)
            own = self.particles.pressure[j] / self.terms.density
            lift -= ti.math.clamp(gravity.dot(seen - x_j), -own, own) * self.slope[s] * (x - seen)
        return lift

    @ti.func
    def mean_multiplier(self, i):
        """Mean q [m^2] of particle i and its neighbours: what holds them in their arrangement."""
        total, count = self.particles.pressure[i], 1.0
        for s in range(self.neighbours.start[i], self.neighbours.mirrors[i]):
            total += self.particles.pressure[self.neighbours.index[s]]
            count += 1.0
        return total / count

    @ti.kernel
    def move(self, n: ti.i32, dt: ti.f32):
        """v = v* + u/dt, x += dt v; what would leave is stopped at its wall."""
        self.top_rate[None] = 0.0
        for i in range(n):
            m, u = self.layers.mass[self.particles.layer[i]], self.particles.shift[i]
            wall = self.pressure_solve.wall_shift(i, self.particles.pressure)
            self.book_internal(m, self.particles.x[i], (u - wall) / dt)
            self.wall_impulse[None] += m / dt * wall
            if ti.static(self.walls.moving):
                # Force of the bodies on the particle times their velocity.
                self.wall_work[None] += m * self.particles.pressure[i] / dt * self.inflow[i]
            self.particles.v[i] += u / dt
        for i in range(n):
            layer, v = self.particles.layer[i], self.particles.v[i]
            d = self.layers.spacing[layer]
            x = self.particles.x[i] + dt * v
            x, v = self.walls.guard(x, v, self.terms.restitution, self.margin(i))
            self.wall_impulse[None] += self.layers.mass[layer] * (v - self.particles.v[i])
            self.particles.x[i] = x
            self.particles.v[i] = v
            swing = ti.sqrt(self.mean_multiplier(i)) / dt
            if self.particles.density[i] < self.terms.spray * self.terms.density:
                v /= SPRAY_LEAP
            rate = ti.max(v.norm() / self.terms.cfl, swing / self.terms.pressure_cfl) / d
            ti.atomic_max(self.top_rate[None], rate)
