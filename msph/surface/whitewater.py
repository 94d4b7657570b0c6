"""Whitewater: spray, foam and bubbles as passive particles (Ihmsen et al. 2012).

A water particle emits RATE I_k max(I_ta, I_wc) particles per second. I_k, I_ta and I_wc rise
linearly from 0 to 1 over the ranges KINETIC, TRAPPED and CREST:

- kinetic energy: v^2/2;
- trapped air: the mean of |v_ij| (1 - v_ij.x_ij/(|v_ij| |x_ij|)) over the neighbours, large where
  water closes in on itself;
- wave crest: the distance of the neighbours' centre from the particle, over the support, where the
  particle moves out of the water.

Means over neighbours, unlike the sums of the paper, do not depend on the size of particles. The
coverage c of water around a whitewater particle determines its kind: below SPRAY the particle is
spray, which flies; above FOAM a bubble, which rises; in between foam, which moves with the water.
Whitewater does not act on the water.
"""

import taichi as ti

from msph.device_table import DeviceTable
from msph.fluid.boundary.walls import Walls
from msph.launches import data_oriented, heavy_kernel
from msph.state import State
from msph.surface.fluid_fraction import POLY6, cut_share

vec2, vec3 = ti.math.vec2, ti.math.vec3

# Largest number of whitewater particles; new ones replace the oldest.
MOST = 4096
# Whitewater particles per second of a water particle at full potential.
RATE = 100.0
# Ranges of the potentials: specific kinetic energy [m^2/s^2], closing speed [m/s], and offset (-).
KINETIC, TRAPPED, CREST = (0.25, 1.5), (0.25, 0.9), (0.28, 0.45)
# Least cosine between the velocity and the outward normal at a crest (Ihmsen et al. 2012).
OUTWARD = 0.6
# Largest number of particles that a water particle emits in a frame.
BURST = 8
# Radius of the ball around a water particle in which whitewater appears, in spacings, and spread
# of its velocity, in speeds of the particle.
SPREAD, SCATTER = 0.8, 0.25
# Coverages (-) below which whitewater is spray, and from which whitewater is bubbles.
SPRAY, FOAM = 0.15, 0.6
# Longest and shortest lifetime of foam [s].
LIFE, SHORTEST = 3.0, 0.75
# Time [s] in which spray that has landed spreads as foam, and foam turns back.
SPREADING = 0.15
# Rate at which spray and bubbles age, over the rate of foam (-): most become foam first.
SLOW_AGEING = 0.4
# Speed of rising bubbles [m/s] (1 to 5 mm: 0.2 to 0.3 m/s; Clift et al. 1978), and the rate [1/s]
# at which whitewater takes the velocity of the water.
RISE, DRAG = 0.25, 30.0
# Random numbers of a whitewater particle, and factor of a particle's id in the seed of a frame: a
# prime, so that few pairs of id and frame share a seed.
NUMBERS, STRIDE = 8, 7919
# Least length [m] or speed [m/s] for a direction.
LEAST = 1e-9


@ti.dataclass
class Surroundings:
    """Sums over the water particles j around x [m], with the weights
    w_j = peak (1 - |x - x_j|^2 per_r^2)^3, the coverage by particle j: coverage (-), offset of
    x_j - x [m], velocity [m/s], and closing speed [m/s] relative to v [m/s]."""

    x: vec3
    v: vec3
    per_r: ti.f32
    peak: ti.f32
    coverage: ti.f32
    offset: vec3
    velocity: vec3
    closing: ti.f32


def whitewater_of(state: State) -> "Whitewater":
    """Builds the whitewater of a state (for State.build_once)."""
    return Whitewater(state.constants, state.layers, state.grid, state.particles)


@data_oriented
class Whitewater:
    """Whitewater of one simulation. table (MOST,): x [m], v [m/s] and the remaining life (-) of
    particles, 1 at most, 0: none; foam (-): 1 if a particle has spread on the surface.

    emitted[None] counts all particles since reset(); the next one takes the place emitted % MOST.
    """

    def __init__(self, constants, layers, grid, particles):
        self.constants, self.layers, self.walls = constants, layers, Walls(constants)
        self.grid, self.particles = grid, particles
        self.table = DeviceTable((MOST,), x=vec3, v=vec3, life=ti.f32, foam=ti.f32)
        self.emitted = ti.field(ti.i32, shape=())
        self.frames, self.started = 0, False

    def reset(self) -> None:
        """Removes all particles."""
        self.table.fill()
        self.emitted[None] = self.frames = 0
        self.started = False

    def advance(self, dt: float, gravity: tuple[float, float, float], top_speed: float) -> None:
        """Moves the particles by dt [s] under gravity [m/s^2], and emits new ones. top_speed [m/s]:
        of the water; there are no particles until it emits some."""
        self.frames += 1
        self.started = self.started or 0.5 * top_speed**2 > KINETIC[0]
        if self.started:
            self.grid.refresh()
            self._move(dt, ti.Vector(gravity))
            self._emit(self.particles.count, dt, self.frames)

    def compile(self) -> None:
        """Compiles the kernels, by launching them without effect."""
        self._move(0.0, ti.Vector((0.0, 0.0, 0.0)))
        self._emit(0, 0.0, 0)

    @heavy_kernel
    def _emit(self, n: ti.i32, dt: ti.f32, frame: ti.i32):
        for i in range(n):
            v = self.particles.v[i]
            kinetic = ramp(0.5 * v.norm_sqr(), KINETIC)
            if kinetic > 0.0:
                layer = self.particles.layer[i]
                around = self.surroundings(self.particles.x[i], v)
                total = ti.max(around.coverage, LEAST)
                out = -around.offset.normalized(LEAST)
                crest = around.offset.norm() / total * self.layers.per_support[layer]
                potential = ramp(around.closing / total, TRAPPED)
                if v.dot(out) > OUTWARD * v.norm():
                    potential = ti.max(potential, ramp(crest, CREST))
                seed = self.particles.id[i] * STRIDE + frame
                wanted = ti.min(RATE * kinetic * potential * dt, ti.cast(BURST, ti.f32))
                count = ti.cast(wanted + uniform(seed, 0), ti.i32)
                for k in range(count):
                    self.add(i, seed, k)

    @ti.func
    def add(self, i, seed, k):
        """Adds the k-th particle that water particle i emits in a frame."""
        at = ti.atomic_add(self.emitted[None], 1) % MOST
        v, d = self.particles.v[i], self.layers.spacing[self.particles.layer[i]]
        place, spread = vec3(0.0), vec3(0.0)
        for m in ti.static(range(3)):
            place[m] = 2.0 * uniform(seed, NUMBERS * k + m + 1) - 1.0
            spread[m] = 2.0 * uniform(seed, NUMBERS * k + m + 4) - 1.0
        x = self.particles.x[i]
        self.table.x[at] = self.walls.confined(x, x + SPREAD * d * place, 0.0)
        self.table.foam[at] = 0.0
        self.table.v[at] = v + SCATTER * v.norm() * spread
        self.table.life[at] = ti.math.mix(SHORTEST / LIFE, 1.0, uniform(seed, NUMBERS * k + 7))

    @heavy_kernel
    def _move(self, dt: ti.f32, gravity: vec3):
        for k in range(MOST):
            if self.table.life[k] > 0.0:
                x, v, ageing = self.table.x[k], self.table.v[k], SLOW_AGEING
                around = self.surroundings(x, v)
                c, up, foam = around.coverage, -gravity.normalized(LEAST), 0.0
                if c < SPRAY:
                    v += dt * gravity
                else:
                    water = around.velocity / around.coverage
                    wanted = water + RISE * ti.math.clamp(4.0 * (c - 0.5), -1.0, 1.0) * up
                    v += (1.0 - ti.exp(-DRAG * dt)) * (wanted - v)
                    if c < FOAM:
                        ageing, foam = 1.0, 1.0
                moved = x + dt * v
                x = self.walls.confined(x, moved, 0.0)
                self.table.x[k], self.table.v[k] = x, ti.select(x == moved, v, 0.0)
                self.table.life[k] = ti.max(self.table.life[k] - ageing * dt / LIFE, 0.0)
                self.table.foam[k] = ti.math.mix(foam, self.table.foam[k], ti.exp(-dt / SPREADING))

    @ti.func
    def surroundings(self, x, v):
        """Returns the Surroundings of x [m] for a velocity v [m/s]."""
        around = Surroundings(x=x, v=v)
        for layer in range(self.constants.layers[None]):
            per_r, walls, share = self.layers.per_support[layer], self.constants.walls[None], 1.0
            for axis in ti.static(range(3)):
                share *= 1.0 - cut_share(x[axis] * per_r)
                share *= 1.0 - cut_share((walls[axis] - x[axis]) * per_r)
            around.per_r = per_r
            around.peak = POLY6 * self.layers.volume[layer] * per_r**3 / share
            self.grid.for_each_row(x, layer, 1.0 / per_r, self.add_row, around)
        return around

    @ti.func
    def add_row(self, begin, end, around: ti.template()):
        for j in range(begin, end):
            r = self.particles.x[j] - around.x
            u = 1.0 - r.norm_sqr() * around.per_r**2
            if u > 0.0:
                w = around.peak * u * u * u
                v = self.particles.v[j]
                closing = around.v - v
                around.coverage += w
                around.offset += w * r
                around.velocity += w * v
                # v_ij and x_ij = -r: water that closes in has v_ij.x_ij < 0.
                towards = closing.dot(r) / ti.max(r.norm(), LEAST)
                around.closing += w * (closing.norm() + towards)


@ti.func
def ramp(x, ends: ti.template()):
    """Returns a value that rises linearly from 0 at x = ends[0] to 1 at x = ends[1]."""
    return ti.math.clamp((x - ends[0]) / (ends[1] - ends[0]), 0.0, 1.0)


@ti.func
def uniform(seed, k):
    """Returns the k-th number in [0, 1) of a seed: the hash PCG of O'Neill (2014), which does not
    depend on the order of threads."""
    state = (ti.cast(seed, ti.u32) * ti.u32(31) + ti.cast(k, ti.u32)) * ti.u32(747796405)
    state += ti.u32(2891336453)
    word = ((state >> ((state >> ti.u32(28)) + ti.u32(4))) ^ state) * ti.u32(277803737)
    word = (word >> ti.u32(22)) ^ word
    return ti.cast(word >> ti.u32(8), ti.f32) / 16777216.0
