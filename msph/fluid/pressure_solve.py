"""The pressure solve: multipliers q >= 0 whose displacements undo a given compression."""

import math

import taichi as ti

from msph.fluid.layers import Layers
from msph.fluid.neighbours import NeighbourList
from msph.fluid.particles import Attribute, Particles
from msph.launch import data_oriented, kernel

# What a solve reads and leaves on the particles.
ATTRIBUTES = (
    Attribute("source", "-", "compression that a solve must undo", carried=False),
    Attribute("gradient", "1/m", "sum V_j grad W_ij, images included", width=3, carried=False),
    Attribute("diagonal", "1/m^2", "diagonal of the solves' operator", carried=False),
    Attribute("shift", "m", "displacement by a solve", width=3, carried=False),
    Attribute("residual", "-", "compression left by a solve", carried=False),
    Attribute("direction", "m^2", "search direction of a solve", carried=False),
    Attribute("response", "-", "compression that the direction undoes", carried=False),
    Attribute("free", "-", "1 where a solve may change the multiplier", carried=False),
)
# Where bodies stand in the water.
WALL_ATTRIBUTES = (
    Attribute("wall", "1/m", "gradient of the bodies' part of c", width=3, carried=False),
)

# Keeps divisions by what may vanish finite; far below any diagonal [1/m^2] or curvature met.
TINY = 1e-30
# Iterations between looks at the error, which wait for the device; they share a launch.
LOOK = 2
# What a look tells.
GO_ON, ROUND_OVER, SOLVED = 0, 1, 2
# Most looks in a round of conjugate gradients.
ROUND = 20
# By how much the start of a solve may be scaled; one farther off is no guess.
LEAST_SCALED, MOST_SCALED = 0.5, 2.0
# Displacements, in spacings, that count as none: a share of them is left even by the best stop.
STILL = 1e-5
# Under-relaxation of Jacobi: stable below 2/lambda_max, which was .68, .53 and .31 at 27, 57 and 97
# neighbours; this many over the neighbours stays clear of it, and at most the second.
DAMPING, LEAST_DAMPING = 24.0, 0.5


@data_oriented
class PressureSolve:
    """Finds q >= 0 [m^2] and u_i = -sum V_j (q_i + q_j) grad W_ij [m], so that
    source_i + sum V_j (u_i - u_j).grad W_ij <= 0, and = 0 where q > 0.

    Sums run over neighbours and their images; bodies add u_i.wall_i to the one and -q_i wall_i to
    the other, the gradient of their part of the kernel's integral. Divergence and gradient are
    adjoint, so the operator A is symmetric and positive under the weights V, and
    sum V |u|^2 = <q, A q>. pair_gradient holds V_j grad W_ij [1/m] of each entry of the neighbour
    list.
    """

    def __init__(
        self,
        layers: Layers,
        particles: Particles,
        neighbours: NeighbourList,
        pair_gradient: ti.MatrixField,
        bodies: bool,
    ):
        self.layers, self.particles = layers, particles
        self.neighbours, self.pair_gradient = neighbours, pair_gradient
        widest = max(s.smoothing for s in layers.specs)
        self.omega = min(LEAST_DAMPING, DAMPING / (4.0 / 3.0 * math.pi * widest**3))
        self.images, self.bodies = neighbours.images, bodies
        self.descent = ti.field(ti.f32, shape=())
        self.scale = ti.field(ti.f32, shape=())

    def converge(self, q, dt: float, tolerance: float, leeway: float, most: int) -> int:
        """Projected conjugate gradients from the multipliers q (capacity,) [m^2], changed in place.
        Returns the iterations it took, at most `most` (and LOOK).

        What an iteration takes off the error of q in <q, A q>, it takes off sum V |u|^2 of the
        displacements' error (Hestenes and Stiefel 1952, th. 6:1). The solve stops when LOOK
        iterations together have changed the displacements by less than the share `tolerance` of
        their root mean square. Measures of the compression would not do: while a deep column
        falls only its lowest particles are compressed. What the particles go in the step of dt [s],
        less their mean, counts as `leeway` (-) times a displacement: in still water every error
        stirs it, in a dam break one of a hundredth of its speed is lost, and takes half the
        iterations.

        First the start is scaled as far as that helps. What a column's pressures are off by all
        together, even less than the tolerance, lifts or drops it: the energy of a layered tank
        went up and down by .004 % from frame to frame, by .001 % where the start is scaled.

        Within a round those particles push that have q > 0 or are compressed, less those that
        reach q = 0. A round ends early when the others have become more compressed than they.
        """
        n, alone = self.particles.count, self.particles.alone
        taken, state = 0, ROUND_OVER
        while taken < most and state != SOLVED:
            state = self.begin(n, alone, q, dt, leeway, tolerance)
            taken += LOOK
            for _ in range(ROUND - 1):
                if state != GO_ON or taken >= most:
                    break
                state = self.iterate(n, alone, q, tolerance)
                taken += LOOK
        return taken

    @kernel
    def relax(self, n: ti.i32, alone: ti.template(), q: ti.template(), iterations: ti.template()):
        """Jacobi from the multipliers q (capacity,) [m^2], changed in place.

        Unlike conjugate gradients it never reaches for the long, nearly free modes of a regular
        arrangement, whose displacements are large and whose linearised compression is none.
        """
        self.relax_all(n, alone, q, iterations)

    @ti.func
    def relax_all(self, n, alone: ti.template(), q: ti.template(), iterations: ti.template()):
        """relax(), within a kernel."""
        for _ in ti.static(range(iterations)):
            ti.loop_config(serialize=alone)
            for i in range(n):
                self.particles.shift[i] = self.shift_by(i, q)
            ti.loop_config(serialize=alone)
            for i in range(n):
                r = self.particles.source[i] + self.divergence(i, self.particles.shift)
                q[i] = self.corrected(i, q[i], r)

    @ti.func
    def corrected(self, i, q, r):
        """Multiplier of i after q += omega r/D, not below 0; r the compression left by q."""
        return ti.max(q + self.omega * r / ti.max(self.particles.diagonal[i], TINY), 0.0)

    @ti.func
    def shift_by(self, i, q: ti.template()):
        """u_i = -(q_i g_i + sum V_j q_j grad W_ij) [m]."""
        u = -q[i] * self.particles.gradient[i]
        for s in range(self.neighbours.start[i], self.neighbours.end[i]):
            u -= q[self.images.neighbour(self.neighbours.index[s])] * self.pair_gradient[s]
        return u

    @ti.func
    def inner_shift(self, i, q: ti.template()):
        """The part of u_i [m] that other particles give."""
        u = ti.Vector([0.0, 0.0, 0.0])
        for s in range(self.neighbours.start[i], self.neighbours.mirrors[i]):
            u -= (q[i] + q[self.neighbours.index[s]]) * self.pair_gradient[s]
        return u

    @ti.func
    def wall_shift(self, i, q: ti.template()):
        """The part of u_i [m] that walls give."""
        u = ti.Vector([0.0, 0.0, 0.0])
        if ti.static(self.bodies):
            u = -q[i] * self.particles.wall[i]
        for s in range(self.neighbours.mirrors[i], self.neighbours.end[i]):
            j = self.images.neighbour(self.neighbours.index[s])
            u -= (q[i] + q[j]) * self.pair_gradient[s]
        return u

    @ti.func
    def divergence(self, i, field: ti.template()):
        """sum V_j (u_i - u_j).grad W_ij of a vector field u [u's unit / m]."""
        u, found = field[i], 0.0
        if ti.static(self.bodies):
            found = u.dot(self.particles.wall[i])
        for s in range(self.neighbours.start[i], self.neighbours.mirrors[i]):
            j = self.neighbours.index[s]
            found += (u - field[j]).dot(self.pair_gradient[s])
        for s in range(self.neighbours.mirrors[i], self.neighbours.end[i]):
            j, mirror, _ = self.images.read(self.neighbours.index[s])
            found += (u - mirror * field[j]).dot(self.pair_gradient[s])
        return found

    @kernel
    def find_shifts(self, n: ti.i32, alone: ti.template(), q: ti.template(), shifts: ti.template()):
        """The displacements u that the multipliers q give."""
        ti.loop_config(serialize=alone)
        for i in range(n):
            shifts[i] = self.shift_by(i, q)

    @kernel
    def begin(
        self,
        n: ti.i32,
        alone: ti.template(),
        q: ti.template(),
        dt: ti.f32,
        leeway: ti.f32,
        tolerance: ti.f32,
    ) -> ti.i32:
        """q scaled to the least <q - x, A (q - x)> from the solution x, by <q, source>/<q, A q>;
        r = source - A q; first direction r/D where particles push, 0 elsewhere; and the first
        iterate(), whose state it returns."""
        ti.loop_config(serialize=alone)
        for i in range(n):
            self.particles.shift[i] = self.shift_by(i, q)
        asked, given = 0.0, 0.0
        ti.loop_config(serialize=alone)
        for i in range(n):
            response = -self.divergence(i, self.particles.shift)
            self.particles.response[i] = response
            weight = self.layers.volume[self.particles.layer[i]] * q[i]
            asked += weight * self.particles.source[i]
            given += weight * response
        scaled = 1.0
        if given > TINY:
            scaled = ti.math.clamp(asked / given, LEAST_SCALED, MOST_SCALED)
        descent, scale, whole, square, drift = 0.0, 0.0, 0.0, 0.0, ti.Vector([0.0, 0.0, 0.0])
        ti.loop_config(serialize=self.particles.light)
        for i in range(n):
            layer = self.particles.layer[i]
            r = self.particles.source[i] - scaled * self.particles.response[i]
            self.particles.residual[i] = r
            q[i] *= scaled
            volume, spacing = self.layers.volume[layer], self.layers.spacing[layer]
            d = ti.max(self.particles.diagonal[i], TINY)
            free = ti.select(q[i] > 0.0 or r > 0.0, 1.0, 0.0)
            self.particles.free[i] = free
            self.particles.direction[i] = free * r / d
            descent += free * volume * r * r / d
            u = scaled * self.particles.shift[i]
            way = dt * self.particles.v[i] + u
            scale += volume * (u.norm_sqr() + (STILL * spacing) ** 2)
            whole += volume
            square += volume * way.norm_sqr()
            drift += volume * way
        # Less what all water goes together: a drop that falls fast is no less round.
        apart = ti.max(square - drift.norm_sqr() / whole, 0.0)
        self.descent[None], self.scale[None] = descent, scale + leeway**2 * apart
        return self.iterate_all(n, alone, q, tolerance)

    @kernel
    def iterate(
        self, n: ti.i32, alone: ti.template(), q: ti.template(), tolerance: ti.f32
    ) -> ti.i32:
        """iterate_all(), as a kernel."""
        return self.iterate_all(n, alone, q, tolerance)

    @ti.func
    def iterate_all(self, n, alone: ti.template(), q: ti.template(), tolerance):
        """LOOK steps along directions p: q += alpha p, not below 0; r -= alpha A p; and where
        particles push p = r/D + beta p.

        Returns SOLVED where they changed sum V |u|^2 by less than tolerance^2 of it, ROUND_OVER
        where those that do not push are more compressed than those that do.
        """
        gain, excluded = 0.0, 0.0
        for _ in ti.static(range(LOOK)):
            ti.loop_config(serialize=alone)
            for i in range(n):
                self.particles.shift[i] = self.shift_by(i, self.particles.direction)
            curvature = 0.0
            ti.loop_config(serialize=alone)
            for i in range(n):
                response = -self.divergence(i, self.particles.shift)
                self.particles.response[i] = response
                volume = self.layers.volume[self.particles.layer[i]]
                curvature += volume * self.particles.direction[i] * response
            last = self.descent[None]
            alpha = last / ti.max(curvature, TINY)
            gain += last * alpha
            descent = 0.0
            excluded = 0.0
            ti.loop_config(serialize=self.particles.light)
            for i in range(n):
                r = self.particles.residual[i] - alpha * self.particles.response[i]
                moved = q[i] + alpha * self.particles.direction[i]
                if moved < 0.0:
                    self.particles.free[i] = 0.0
                q[i] = ti.max(moved, 0.0)
                self.particles.residual[i] = r
                d = ti.max(self.particles.diagonal[i], TINY)
                part = self.layers.volume[self.particles.layer[i]] * r * r / d
                descent += self.particles.free[i] * part
                excluded += (1.0 - self.particles.free[i]) * ti.select(r > 0.0, part, 0.0)
            beta = descent / ti.max(last, TINY)
            self.descent[None] = descent
            ti.loop_config(serialize=self.particles.light)
            for i in range(n):
                d = ti.max(self.particles.diagonal[i], TINY)
                self.particles.direction[i] = self.particles.free[i] * (
                    self.particles.residual[i] / d + beta * self.particles.direction[i]
                )
        self.scale[None] += gain
        over = ti.select(excluded > self.descent[None], ROUND_OVER, GO_ON)
        return ti.select(gain < tolerance * tolerance * self.scale[None], SOLVED, over)
