"""Conjugate gradients on the particles, projected or preconditioned, for pressure and viscosity.

Solves A x = b for an operator A that is symmetric and positive under the volumes V,
<x, y> = sum V x.y, preconditioned by its diagonal D where one is given (Hestenes and Stiefel 1952;
Saad 2003, alg. 9.1). Without a preconditioner every iterate keeps <y, x> for all y with A y = y,
such as the momenta under viscosity.

Projected: x >= 0. Then only active particles are searched along, those with x > 0 or r > 0, less
those that reach x = 0; a round of conjugate gradients ends when the residual of the others exceeds
that of the active ones.

What an iteration takes off the squared error, in the norm of A, is alpha <r, r/D> (Hestenes and
Stiefel 1952, th. 6:1); what the last few took off tells what is left (Strakos and Tichy 2002).
"""

from collections.abc import Callable
from typing import Any

import taichi as ti

from msph.fluid.particles.layers import Layers
from msph.fluid.particles.particles import Particles
from msph.taichi_internals import data_oriented, kernel, on_cpu

# Keeps divisions by what may vanish finite; far below any diagonal or product met.
TINY = 1e-30
# A squared error that is not known yet.
FAR = 1e30
# Iterations in a launch: between two, the host looks at the state, for which it waits. On a CPU
# that is 5 us, less than the iterations saved; on a GPU as long as an iteration.
LOOK_CPU, LOOK_GPU = 1, 2
# What a look tells.
GO_ON, ROUND_OVER, CONVERGED = 0, 1, 2
# Most iterations in a round of a projected solve.
ROUND = 40


@data_oriented
class ConjugateGradient:
    """operator.apply(n, direction) returns <direction, A direction>; after it
    operator.response(i, direction) is A direction at particle i. So where an operator knows the
    first without the second, the pass that finds the response takes the step too.

    residual, direction and diagonal are fields (capacity,) of x's width; active, for
    projected solves of scalars, is 1 where x may change. scale [x's unit^2 m^3] is the squared
    size, in the norm of A, that the tolerance is a share of; descent is <r, r/D>. begin_round()
    sets both.
    """

    def __init__(
        self,
        layers: Layers,
        particles: Particles,
        operator: Any,
        residual: ti.Field,
        direction: ti.Field,
        diagonal: ti.Field | None = None,
        active: ti.Field | None = None,
    ):
        self.layers, self.particles, self.operator = layers, particles, operator
        self.residual, self.direction = residual, direction
        self.diagonal, self.active, self.projected = diagonal, active, active is not None
        self.vectors = isinstance(residual, ti.MatrixField)
        self.has_diagonal = diagonal is not None
        self.look = LOOK_CPU if on_cpu() else LOOK_GPU
        self.descent = ti.field(ti.f32, shape=())
        self.scale = ti.field(ti.f32, shape=())
        self.last_gain = ti.field(ti.f32, shape=())

    def solve(self, x: ti.Field, tolerance: float, most: int, begin: Callable[[], None]) -> int:
        """Iterates on x, in place, and returns the iterations it took, at most `most` (and the
        rest of a launch).

        begin() sets residual, direction and active and calls begin_round() at the start of each
        round, of which an unprojected solve has one. The solve has converged when two iterations
        together take off less than the share `tolerance` of sqrt(scale), in the norm of A.
        """
        n = self.particles.count
        taken, state = 0, ROUND_OVER
        while taken < most and state != CONVERGED:
            begin()
            state, ends = GO_ON, min(most, taken + ROUND) if self.projected else most
            while taken < ends and state == GO_ON:
                state = self._iterate(n, x, tolerance)
                taken += self.look
        return taken

    @kernel
    def _iterate(self, n: ti.i32, x: ti.template(), tolerance: ti.f32) -> ti.i32:
        """x += alpha p; r -= alpha A p; p = r/D + beta p. Returns the state after the last."""
        gains, excluded = 0.0, 0.0
        for _ in ti.static(range(self.look)):
            curvature = self.operator.apply(n, self.direction)
            last = self.descent[None]
            alpha = last / ti.max(curvature, TINY)
            gain = last * alpha
            gains = self.last_gain[None] + gain
            self.last_gain[None] = gain
            descent = 0.0
            excluded = 0.0
            for i in range(n):
                volume = self.layers.volume[self.particles.layer[i]]
                r = self.residual[i] - alpha * self.operator.response(i, self.direction)
                moved = x[i] + alpha * self.direction[i]
                part = volume * self.product(r, self.preconditioned(i, r))
                if ti.static(self.projected):
                    if moved < 0.0:
                        self.active[i] = 0.0
                    moved = ti.max(moved, 0.0)
                    excluded += (1.0 - self.active[i]) * ti.select(r > 0.0, part, 0.0)
                    part *= self.active[i]
                x[i] = moved
                self.residual[i] = r
                descent += part
            beta = descent / ti.max(last, TINY)
            self.descent[None] = descent
            for i in range(n):
                p = self.preconditioned(i, self.residual[i]) + beta * self.direction[i]
                if ti.static(self.projected):
                    p *= self.active[i]
                self.direction[i] = p
            self.scale[None] += gain
        state = ti.select(excluded > self.descent[None], ROUND_OVER, GO_ON)
        return ti.select(gains <= tolerance * tolerance * self.scale[None], CONVERGED, state)

    @ti.func
    def begin_round(self, descent, scale):
        """Takes <r, r/D> and the tolerance's scale. No gain of one iteration alone is small."""
        self.descent[None], self.scale[None], self.last_gain[None] = descent, scale, FAR

    @ti.func
    def preconditioned(self, i, r):
        """r/D, or r where there is no preconditioner."""
        found = r
        if ti.static(self.has_diagonal):
            found = r / ti.max(self.diagonal[i], TINY)
        return found

    @ti.func
    def product(self, a, b):
        """a b of scalars, a.b of vectors."""
        found = 0.0
        if ti.static(self.vectors):
            found = a.dot(b)
        else:
            found = a * b
        return found
