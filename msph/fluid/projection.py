"""The projection method: incompressible, momentum-conserving SPH over layers of any size.

Symmetric kernel W_ij = W(r_ij, h_ij), so that every pair force is equal and opposite whatever the
masses; walls are mirrors; two pressure solves, one that makes velocities divergence-free and one
that moves particles apart without giving them velocity (after Bender and Koschier 2015, DFSPH, made
conservative for unequal masses).
"""

import math

import taichi as ti

from msph.fluid import adaptation, pressure_solve, separation, tension, viscosity
from msph.fluid.accounts import Accounts
from msph.fluid.adaptation import Adaptation
from msph.fluid.forcing import Forcing, hand_acceleration
from msph.fluid.grid import LayeredGrid
from msph.fluid.images import Images
from msph.fluid.layers import Layers
from msph.fluid.neighbours import NeighbourList
from msph.fluid.obstacles import Walls
from msph.fluid.pair_pressure import PairPressure
from msph.fluid.particles import Attribute, Particles
from msph.fluid.pressure_solve import WALL_ATTRIBUTES, PressureSolve
from msph.fluid.projection_terms import ProjectionTerms
from msph.fluid.separation import Separation
from msph.fluid.summation import UNKNOWN, Summation
from msph.fluid.tension import Tension
from msph.fluid.viscosity import Viscosity
from msph.fluid.xsph import Xsph
from msph.launch import data_oriented, kernel

_ATTRIBUTES = (
    Attribute("density", "kg/m^3", "relative density c times rest density"),
    Attribute("pressure", "Pa", "mean over its pairs of what they press with"),
    Attribute("multiplier", "Pa", "of the velocity solve: pairs press with the mean of theirs"),
    Attribute("earlier", "Pa", "multiplier of the step before"),
    Attribute("looseness", "-", "density by a kernel without forces, less c", carried=False),
    Attribute("hidden", "-", "what c hides: looseness round it, not above 0"),
    *separation.ATTRIBUTES,
    *pressure_solve.ATTRIBUTES,
)

# Rounds of the position solve before time starts, at most, and the excess of density that they may
# leave: what is left lifts the water later. 60 fine sheets of halved cubes take 161; stopped at 100
# their energy rose by .16 % in the first second, then by .02 %.
ARRANGING, LOOSE = 400, 1e-3
# How much stricter, and longer, the first solve of a run is, and how much shorter its step.
FIRST_CARE = 10
# Deficit of density up to which a gap beside a merger is not yet to be closed.
SMALL_GAP = 0.1
# Deficit of density from which on water may fall together within a step. What the position solve
# leaves thinner than rest by less must not be let fall: it would carry a part of the weight, and
# the pressure of a deep pool would be up to 8 % too low.
GAP = 0.003
# Looseness that particles at rest may have, and the most that is made up for (honey hid .07). Not
# under tension, where particles of a drop pair up, which hides more, till it has shrunk by 7 %.
EVEN, MOST_HIDDEN = 0.003, 0.06
# Share of a step's reading in what is taken for hidden: the whole would swing from step to step.
BLEND = 0.25
# Share of a particle's volume: keeps the mean over none finite.
SMALLEST = 1e-3
# How many times farther than past its neighbours a particle may move in a step: at 1.5 and 2 the
# bulk density of a dam break was off by .8 and 1.3 % at the impact, not .6. And spray, for it meets
# nothing.
LEAP, SPRAY_LEAP = 1.25, 2.5


@data_oriented
class Projection(Accounts):
    """One solver over the particles of all layers.

    Both solves are one PressureSolve. The position solve displaces by its shifts u; the velocity
    solve gives v += u/dt, and its multiplier is q = dt^2 p/rho0.
    """

    # Of each list one step is made: a margin would add a third to all its sums.
    LIST_MARGIN = 0.0
    # Numbers stored beside each neighbour: its gradient.
    PER_ENTRY = 3

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
        self.summation = Summation(walls, layers, particles, self.neighbours, terms.density)
        self.pressure_solve = PressureSolve(
            layers, particles, self.neighbours, self.summation.pair_gradient, walls.count > 0
        )
        self.pair_pressure = PairPressure(
            layers, particles, self.neighbours, self.summation.pair_gradient
        )
        self.separation = Separation(
            self,
            walls,
            layers,
            particles,
            self.neighbours,
            self.summation,
            self.pressure_solve,
            terms.density,
            terms.position_iterations,
            terms.largest_shift,
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
            self.tension = Tension(layers, particles, self.summation, terms.tension)
        if terms.xsph:
            self.xsph = Xsph(layers, particles, self.neighbours, terms.xsph)
        # Whether no other force stands between push and aim.
        self.nothing_between = not (terms.tension or terms.viscosity)
        self.top_rate = 0.0  # [1/s], of what bounds the step
        self.adaptation = None
        if terms.adaptation:
            self.adaptation = Adaptation(
                walls, layers, particles, self.neighbours, self.merge_loss, terms.adaptation
            )
        self.adaptive = self.adaptation is not None
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
        return "pair"

    def reset(self) -> None:
        """Forgets what it knew of the particles: they were replaced."""
        self.clear_accounts()
        self.top_rate = 0.0
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
        if self.adaptation:
            self.adaptation.fill()
            self.disturb()
        for _ in range(ARRANGING):
            self.neighbours.refresh()
            crowded = self.separation.find(self.particles.count, 0.0) > LOOSE
            if crowded:
                self.separation.part(self.particles.count, self.particles.alone)
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

    def longest_step(self, leeway: float = 1.0) -> float:
        """Largest time step [s] now, `leeway` times as short as motion and pressure allow.

        No particle moves farther than cfl of its spacing past its neighbours and walls, nor farther
        than LEAP times as much. And forces are constant within a step, while an arrangement under
        the pressure p swings at up to about 2 sqrt(p/rho0)/d: longer steps make deep fine water
        boil and collapse, however well each step's pressure converges. 60 sheets were still at
        pressure_cfl = .7 and collapsed at 1.4. There d is the spacing of a particle's pairs.
        """
        # Nor may a body overtake what it pushes.
        body = self.walls.top_speed / (self.terms.cfl * self.layers.finest.spacing)
        rate = max(self.top_rate, body)
        bound = 1.0 / (leeway * rate) if rate > 0.0 else self.terms.longest_step
        longest = min(bound, self.terms.longest_step)
        if self.tension:
            longest = min(longest, self.tension.longest_step)
        # Before the first solve no pressure is known.
        return longest / FIRST_CARE if self.first else longest

    def step(self, dt: float, forcing: Forcing) -> None:
        """Neighbours and sums; how the crowded must part; forces; velocities without compression;
        part and move."""
        n, alone = self.particles.count, self.particles.alone
        self.neighbours.refresh()
        self.separation.find(n, dt)
        if self.xsph:
            self.xsph.run(n)
        self.push(n, alone, dt, *forcing.arguments())
        if self.tension:
            self.tension.run(n, dt)
        if self.viscosity:
            self.viscosity.run(n, dt)
        if not self.nothing_between:
            self.aim_at_no_compression(n, alone, dt)
        # The first solve knows no pressure to start from, and what it leaves would fall.
        care = FIRST_CARE if self.first else 1
        self.iterations = self.pressure_solve.converge(
            self.particles.multiplier,
            dt,
            self.terms.tolerance / care,
            self.terms.motion_tolerance / self.terms.tolerance,
            care * self.terms.velocity_iterations,
        )
        self.first = False
        self.top_rate = self.move(n, alone, dt, *forcing.gravity)
        self.disturb()
        if self.adaptation and self.adaptation.due():
            self.adaptation.run()

    @kernel
    def aim_at_no_compression(self, n: ti.i32, alone: ti.template(), dt: ti.f32):
        """aim_all(), as a kernel."""
        self.aim_all(n, alone, dt)

    @ti.func
    def aim_all(self, n, alone: ti.template(), dt):
        """source_i = dt dc/dt + share (c_i - 1) of the velocity solve, c_i as it will be once the
        crowded have parted; and multipliers [Pa] become the solve's [m^2].

        They start from the mean of two steps: they swing from one to the next, so that it
        takes half the iterations that the last step's do; to extrapolate takes more.

        share is 1 for gaps, and dt/release for what is crowded or hardly thinner than rest.
        """
        ti.loop_config(serialize=alone)
        for i in range(n):
            rate = self.pressure_solve.divergence(i, self.particles.v)
            if ti.static(self.walls.moving):
                rate += self.summation.inflow[i]
            c = self.particles.density[i] / self.terms.density - 1.0
            c += self.pressure_solve.divergence(i, self.particles.parting)
            self.particles.density[i] = self.terms.density * (1.0 + c)
            if 1.0 + c < self.terms.spray:
                rate = ti.min(rate, 0.0)
            share = ti.max(dt / self.terms.release, -c / GAP)
            wanted = ti.min(share, 1.0) * c
            if ti.static(self.adaptive):
                # Halves are crowded, and mergers leave gaps, until the position solve has met them.
                wanted = ti.select(self.particles.settling[i] > 0 and c > -SMALL_GAP, 0.0, wanted)
            self.particles.source[i] = dt * rate + wanted
            now = self.particles.multiplier[i]
            start = 0.5 * (now + self.particles.earlier[i])
            self.particles.earlier[i] = now
            self.particles.multiplier[i] = start * dt * dt / self.terms.density

    @kernel
    def push(
        self,
        n: ti.i32,
        alone: ti.template(),
        dt: ti.f32,
        g_x: ti.f32,
        g_y: ti.f32,
        g_z: ti.f32,
        hand_x: ti.f32,
        hand_y: ti.f32,
        hand_z: ti.f32,
        hand_v_x: ti.f32,
        hand_v_y: ti.f32,
        hand_v_z: ti.f32,
        hand_radius: ti.f32,
        hand_grip: ti.f32,
    ):
        """v* = v + dt (g + what the hand gives + what gravity adds to the walls' pressures); and,
        where no other force follows, aim_all()."""
        gravity, hand_at = ti.math.vec3(g_x, g_y, g_z), ti.math.vec3(hand_x, hand_y, hand_z)
        hand_v = ti.math.vec3(hand_v_x, hand_v_y, hand_v_z)
        ti.loop_config(serialize=alone)
        for i in range(n):
            m = self.layers.mass[self.particles.layer[i]]
            x, v = self.particles.x[i], self.particles.v[i]
            lift = self.pair_pressure.lift(i, gravity, 1.0 / self.terms.density)
            hand = hand_acceleration(x, v, dt, hand_at, hand_v, hand_radius, hand_grip)
            self.book_hand(m, v, dt, hand, gravity + lift)
            self.wall_impulse[None] += m * dt * lift
            self.particles.v[i] = v + dt * (gravity + lift + hand)
        if ti.static(self.nothing_between):
            self.aim_all(n, alone, dt)

    @ti.func
    def looseness_round(self, i):
        """Mean (-) over particle i and its neighbours, where it is known.

        Weighed by volume: between layers coarse particles seem loose and fine ones crowded, which
        cancels.
        """
        own = self.layers.volume[self.particles.layer[i]]
        looseness, known = 0.0, 0.0
        if self.particles.looseness[i] < UNKNOWN:
            looseness, known = own * self.particles.looseness[i], own
        for s in range(self.neighbours.start[i], self.neighbours.mirrors[i]):
            j = self.neighbours.index[s]
            if self.particles.looseness[j] < UNKNOWN:
                volume = self.layers.volume[self.particles.layer[j]]
                looseness += volume * self.particles.looseness[j]
                known += volume
        return looseness / ti.max(known, SMALLEST * own)

    @kernel
    def move(
        self,
        n: ti.i32,
        alone: ti.template(),
        dt: ti.f32,
        g_x: ti.f32,
        g_y: ti.f32,
        g_z: ti.f32,
    ) -> ti.f32:
        """Velocities without compression; the crowded part; all go their way. Returns the
        largest rate [1/s] that bounds the next step.
        """
        swing = self.accelerate(n, alone, dt, ti.math.vec3(g_x, g_y, g_z))
        self.separation.part_all(n, alone)
        return ti.max(swing, self.let_go(n, dt))

    @ti.func
    def accelerate(self, n, alone: ti.template(), dt, gravity):
        """v = v* + u/dt; pressures; and what densities hide. Returns the largest rate [1/s] by
        which pressure bounds the next step."""
        top = 0.0
        ti.loop_config(serialize=alone)
        for i in range(n):
            m = self.layers.mass[self.particles.layer[i]]
            inner = self.pressure_solve.inner_shift(i, self.particles.multiplier)
            wall = self.pressure_solve.wall_shift(i, self.particles.multiplier)
            self.book_internal(m, self.particles.x[i], inner / dt)
            self.wall_impulse[None] += m / dt * wall
            if ti.static(self.walls.moving):
                # Force of the bodies on the particle times their velocity.
                self.wall_work[None] += (
                    m * self.particles.multiplier[i] / dt * self.summation.inflow[i]
                )
            self.particles.v[i] += (inner + wall) / dt
            kinematic = self.pair_pressure.at(i, gravity, 1.0 / (dt * dt))
            self.particles.pressure[i] = self.terms.density * kinematic
            swing = ti.sqrt(ti.max(kinematic, 0.0))
            ti.atomic_max(top, swing / (self.terms.pressure_cfl * self.pair_pressure.spacing(i)))
            if ti.static(not self.tension):
                target = ti.math.clamp(self.looseness_round(i) + EVEN, -MOST_HIDDEN, 0.0)
                self.particles.hidden[i] += BLEND * (target - self.particles.hidden[i])
        return top

    @ti.func
    def let_go(self, n, dt):
        """x += dt v; what would leave is stopped at its wall. Multipliers become pressures. Returns
        the largest rate [1/s] by which motion bounds the next step."""
        top, farthest = 0.0, 0.0
        ti.loop_config(serialize=self.particles.light)
        for i in range(n):
            layer, v = self.particles.layer[i], self.particles.v[i]
            d = self.layers.spacing[layer]
            x = self.particles.x[i] + dt * v
            x, v = self.walls.guard(x, v, self.terms.restitution, self.separation.margin(i))
            self.wall_impulse[None] += self.layers.mass[layer] * (v - self.particles.v[i])
            self.particles.x[i] = x
            self.particles.v[i] = v
            self.particles.multiplier[i] *= self.terms.density / (dt * dt)
            speed = v.norm()
            pace = ti.math.clamp(self.particles.pace[i], speed / LEAP, speed)
            if self.particles.density[i] < self.terms.spray * self.terms.density:
                speed /= SPRAY_LEAP
                pace = speed
            ti.atomic_max(farthest, speed * dt / d)
            ti.atomic_max(top, pace / (self.terms.cfl * d))
        if ti.static(self.adaptive):
            self.adaptation.travelled[None] += farthest
        return top
