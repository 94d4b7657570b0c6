"""The position solve: particles that are crowded move apart, without gaining velocity."""

import taichi as ti

from msph.fluid.accounts import Accounts
from msph.fluid.layers import Layers
from msph.fluid.neighbours import NeighbourList
from msph.fluid.obstacles import BEGIN, Walls
from msph.fluid.particles import Attribute, Particles
from msph.fluid.pressure_solve import PressureSolve
from msph.fluid.summation import TINY, Summation
from msph.launch import data_oriented, kernel

ATTRIBUTES = (
    Attribute("crowding", "m^2", "multiplier of the position solve", carried=False),
    Attribute("parting", "m", "displacement that ends crowding", width=3, carried=False),
    Attribute("exchange", "m/s", "velocity given by neighbours", width=3, carried=False),
    Attribute("pace", "m/s", "fastest at which neighbours and walls pass by", carried=False),
)

# Excess of density from which on the position solve takes so many rounds: waves reach the first,
# halves after a split the second. With three for both, up to 1.0 % was left in rocking layers, with
# four .5 to .7, in uniform water .1 to .5. Only the last spreads: more iterations leave less of the
# spreading, and the water dropped for a step by up to .01 % of its energy.
URGENT_ROUNDS = {0.02: 3, 0.06: 4}
# In disorder particles of density c = 1 fill more space than evenly spread ones, since each sees
# the peak of its own kernel: water in motion stood 2 to 4 % too thin. So the iterations begin from
# a common pressure of SPREAD more density, of which they leave enough to spread particles evenly
# (a background pressure, as in Adami, Hu and Adams 2013), where no more than THIN of it is missing.
# Shear loses stiffness by it: at .005 uniform water 15 spacings deep sloshes in time, at .0265 1 %
# too slow, and 2.2 % if steps are less than half as long (supports of 2.5 spacings); and at .018
# pressures in layered water are half as much again off as at .014.
# It lifts the water at its surface a little, which falls back within the step. So it must act in
# every step: where it paused while nothing was crowded, the falling water landed, and pressures
# swung from step to step, up to a sixth of the largest.
SPREAD, THIN = 0.014, 0.03
# Motion upsets an arrangement, so who moves BRISK spacings in a step spreads in full, and in calmer
# water less, in proportion, down to the share LEAST (shifts in proportion to the speed: Skillen,
# Lind, Stansby and Rogers 2013). In full everywhere waves of half a spacing swing 4.9 % too slow,
# not 2.9, and still layered water keeps three times the kinetic energy.
BRISK, LEAST = 0.1, 0.3
# Least distance to a wall, in spacings; the golden section spreads multiples of it evenly.
NEAREST, GOLDEN = 0.05, 0.6180340
# A displacement shorter than this, in spacings, is none.
SMALLEST = 1e-6


@data_oriented
class Separation:
    """Displaces particles by `iterations` of Jacobi, at most `largest_shift` spacings a step; what
    they give each other is booked in `accounts`. density: at rest [kg/m^3]."""

    def __init__(
        self,
        accounts: Accounts,
        walls: Walls,
        layers: Layers,
        particles: Particles,
        neighbours: NeighbourList,
        summation: Summation,
        pressure_solve: PressureSolve,
        density: float,
        iterations: int,
        largest_shift: float,
    ):
        self.accounts, self.walls, self.layers = accounts, walls, layers
        self.particles, self.neighbours = particles, neighbours
        self.summation, self.pressure_solve = summation, pressure_solve
        self.pair_gradient = pressure_solve.pair_gradient
        self.density, self.iterations, self.largest_shift = density, iterations, largest_shift

    def find(self, n: int, dt: float) -> float:
        """Sums of the first n particles, and how they must part; the largest excess of density
        (-). dt [s]: the step; 0 before time starts, when all spread in full."""
        p = self.particles
        crowded = self.aim_at_rest_density(n, p.alone, dt)
        rounds = max((r for least, r in URGENT_ROUNDS.items() if crowded > least), default=0)
        if rounds:
            p.crowding.fill(0.0)
            for _ in range(rounds - 1):
                self.pressure_solve.relax(n, p.alone, p.crowding, self.iterations)
            self.spread(n, p.alone, dt)
        return crowded

    @kernel
    def aim_at_rest_density(self, n: ti.i32, alone: ti.template(), dt: ti.f32) -> ti.f32:
        """The sums; source_i = c_i - 1; and the iterations, of which the first in bulk sees up
        to SPREAD more. Returns the largest excess."""
        self.summation.weigh_all(n, alone)
        most = -1.0
        ti.loop_config(serialize=self.particles.light)
        for i in range(n):
            excess = self.particles.density[i] / self.density - 1.0
            self.particles.source[i] = excess
            self.particles.crowding[i] = self.spreading(i, 0.0, excess, dt)
            ti.atomic_max(most, excess)
        self.relax_rest(n, alone)
        return most

    @kernel
    def spread(self, n: ti.i32, alone: ti.template(), dt: ti.f32):
        """The same iterations after others."""
        ti.loop_config(serialize=alone)
        for i in range(n):
            self.particles.shift[i] = self.pressure_solve.shift_by(i, self.particles.crowding)
        ti.loop_config(serialize=alone)
        for i in range(n):
            r = self.particles.source[i]
            r += self.pressure_solve.divergence(i, self.particles.shift)
            self.particles.crowding[i] = self.spreading(i, self.particles.crowding[i], r, dt)
        self.relax_rest(n, alone)

    @ti.func
    def relax_rest(self, n, alone: ti.template()):
        """All iterations but the first, and how particles part by them."""
        p = self.particles
        self.pressure_solve.relax_all(n, alone, p.crowding, ti.static(self.iterations - 1))
        ti.loop_config(serialize=alone)
        for i in range(n):
            p.parting[i] = self.pressure_solve.shift_by(i, p.crowding)

    @ti.func
    def spreading(self, i, q, r, dt):
        """Multiplier q of i after a correction of the compression r and, in bulk, of as much of
        SPREAD as its way in dt [s] asks for, be it a way that all water goes together."""
        way = dt * self.particles.v[i].norm() / self.layers.spacing[self.particles.layer[i]]
        share = ti.select(dt > 0.0, ti.math.clamp(way / BRISK, LEAST, 1.0), 1.0)
        bulk = self.particles.source[i] > -THIN
        return self.pressure_solve.corrected(i, q, ti.select(bulk, r + share * SPREAD, r))

    @kernel
    def part(self, n: ti.i32, alone: ti.template()):
        """part_all(), as a kernel."""
        self.part_all(n, alone)

    @ti.func
    def part_all(self, n, alone: ti.template()):
        """x += parting, at most `largest_shift` spacings; particles are where find() met them.

        A pair that is moved apart to r (1 + a) keeps its angular momentum only if its relative
        velocity shrinks by a; so v_i -= sum a_ij (v_i - v_j), a_ij = -(q_i + q_j) V_j W'/r >= 0,
        which keeps the momentum too, and adds no energy.

        Leaves each particle's pace [m/s], for who walks over pairs' velocities meets it.
        """
        ti.loop_config(serialize=alone)
        for i in range(n):
            change = ti.Vector([0.0, 0.0, 0.0])
            q, v, x = self.particles.crowding[i], self.particles.v[i], self.particles.x[i]
            pace = self.walls_pace(i, x, v) ** 2
            for s in range(self.neighbours.start[i], self.neighbours.mirrors[i]):
                j = self.neighbours.index[s]
                r_ij = x - self.particles.x[j]
                per_r2 = 1.0 / ti.max(r_ij.norm_sqr(), TINY)
                slope = self.pair_gradient[s].dot(r_ij) * per_r2
                a = slope * (q + self.particles.crowding[j])
                passing = v - self.particles.v[j]
                change += a * passing
                pace = ti.max(pace, passing.norm_sqr())
            self.particles.exchange[i] = change
            self.particles.pace[i] = ti.sqrt(pace)
            m = self.layers.mass[self.particles.layer[i]]
            self.accounts.book_internal(m, x, change)
            wall = self.pressure_solve.wall_shift(i, self.particles.crowding)
            inner = self.limit(i) * (self.particles.parting[i] - wall)
            self.accounts.internal_angular_impulse[None] += m * inner.cross(v + change)
        ti.loop_config(serialize=self.particles.light)
        for i in range(n):
            x = self.particles.x[i] + self.limit(i) * self.particles.parting[i]
            self.particles.x[i] = self.walls.keep(x, BEGIN, self.margin(i))
            self.particles.v[i] += self.particles.exchange[i]

    @ti.func
    def walls_pace(self, i, x, v):
        """Fastest [m/s] at which walls within reach of x come nearer or go; all of |v| by bodies,
        whose sides may face anywhere."""
        h = self.layers.support[self.particles.layer[i]]
        pace, near = 0.0, self.neighbours.images.near(x, h)
        for k in ti.static(range(3)):
            meets = ((near >> k) | (near >> (k + 3))) & 1
            pace = ti.max(pace, meets * abs(v[k]))
        if ti.static(self.walls.count > 0):
            pace = ti.select(self.particles.wall[i].norm_sqr() > 0.0, v.norm(), pace)
        return pace

    @ti.func
    def limit(self, i):
        """Share of the parting that is at most `largest_shift` spacings long."""
        d = self.layers.spacing[self.particles.layer[i]]
        length = ti.max(self.particles.parting[i].norm(), SMALLEST * d)
        return ti.min(1.0, self.largest_shift * d / length)

    @ti.func
    def margin(self, i):
        """Distance [m] from walls at which particle i is stopped: each at its own, since what lies
        in one point cannot part again, and what lies on a wall is not repelled by its image."""
        share = GOLDEN * ti.cast(self.particles.id[i] & 1023, ti.f32)
        d = self.layers.spacing[self.particles.layer[i]]
        return NEAREST * (1.0 + share - ti.floor(share)) * d
