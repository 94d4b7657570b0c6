"""Conjugate gradients over the particles, for pressure (projected) and viscosity.

Solves A x = b for an operator A that is symmetric and positive under the volumes V,
<x, y> = sum V x.y, preconditioned by its diagonal D where one is given (Hestenes and Stiefel 1952;
Saad 2003, alg. 9.1). Without a preconditioner every iterate keeps <y, x> for all y with A y = y,
such as the momenta under viscosity.

A projected solve keeps x >= 0. The search covers active particles only: particles with x > 0 or
r > 0, except particles that have reached x = 0. A round ends when the residual of the other
particles exceeds the residual of the active particles.

One iteration lowers the squared error, in the norm of A, by alpha <r, r/D> (Hestenes and Stiefel
1952, th. 6:1); the reductions of the last iterations estimate the remaining error (Strakos and
Tichy 2002).
"""

from collections.abc import Callable
from typing import Any

import taichi as ti

from msph.fluid.part import Part, Parts
from msph.fluid.small_numbers import MIN_DIVISOR
from msph.launches import data_oriented, kernel
from msph.taichi_internals import on_cpu

# Value of last_reduction before the first iteration of a round.
UNKNOWN_REDUCTION = 1e30
# Iterations per launch; after each launch the host waits for the state. On a CPU a launch takes 5
# us, less than the iterations that it saves, on a GPU as long as an iteration.
LAUNCH_ITERATIONS_CPU, LAUNCH_ITERATIONS_GPU = 1, 2
# States of a solve.
CONTINUE, ROUND_OVER, CONVERGED = 0, 1, 2
# Limit of the iterations in a round of a projected solve.
MAX_ROUND_ITERATIONS = 40


@data_oriented
class ConjugateGradient(Part):
    """Solver for an operator with apply(n, p), which returns <p, A p>, and response(i, p), which
    then returns A p at particle i. Therefore the pass that computes A p also takes the step along
    p.

    residual, direction and diagonal are fields (capacity,) of x's width; active, for projected
    solves of scalars, is 1 where x may change. residual_norm2 is <r, r/D>; scale [unit of <x, A x>]
    is the squared size, in the norm of A, to which the tolerance is relative. set_round() sets
    both.
    """

    def __init__(
        self,
        parts: Parts,
        operator: Any,
        residual: ti.Field,
        direction: ti.Field,
        diagonal: ti.Field | None = None,
        active: ti.Field | None = None,
    ):
        super().__init__(parts)
        self.operator, self.residual, self.direction = operator, residual, direction
        self.diagonal, self.active, self.projected = diagonal, active, active is not None
        self.is_vector = isinstance(residual, ti.MatrixField)
        self.has_diagonal = diagonal is not None
        self.per_launch = LAUNCH_ITERATIONS_CPU if on_cpu() else LAUNCH_ITERATIONS_GPU
        self.residual_norm2 = ti.field(ti.f32, shape=())
        self.scale = ti.field(ti.f32, shape=())
        self.last_reduction = ti.field(ti.f32, shape=())

    def solve(
        self, x: ti.Field, tolerance: float, max_iterations: int, start_round: Callable[[], None]
    ) -> int:
        """Solves for x in place; returns the number of iterations, at most `max_iterations` (and
        the rest of a launch).

        start_round() is called at the start of each round (an unprojected solve has one): it sets
        residual, direction and active and calls set_round(). The solve has converged when two
        iterations together reduce the squared error, in the norm of A, by less than tolerance^2
        times the scale.
        """
        n = self.particles.count
        iterations, state = 0, ROUND_OVER
        while iterations < max_iterations and state != CONVERGED:
            start_round()
            state, end = CONTINUE, max_iterations
            if self.projected:
                end = min(end, iterations + MAX_ROUND_ITERATIONS)
            while iterations < end and state == CONTINUE:
                state = self._iterate(n, x, tolerance)
                iterations += self.per_launch
        return iterations

    @kernel
    def _iterate(self, n: ti.i32, x: ti.template(), tolerance: ti.f32) -> ti.i32:
        """x += alpha p; r -= alpha A p; p = r/D + beta p. Returns the state."""
        reductions, excluded = 0.0, 0.0
        for _ in ti.static(range(self.per_launch)):
            curvature = self.operator.apply(n, self.direction)
            last = self.residual_norm2[None]
            alpha = last / ti.max(curvature, MIN_DIVISOR)
            reduction = last * alpha
            reductions = self.last_reduction[None] + reduction
            self.last_reduction[None] = reduction
            residual_norm2 = 0.0
            excluded = 0.0
            for i in range(n):
                volume = self.layers.volume[self.particles.layer[i]]
                r = self.residual[i] - alpha * self.operator.response(i, self.direction)
                moved = x[i] + alpha * self.direction[i]
                part = volume * self._dot(r, self.preconditioned(i, r))
                if ti.static(self.projected):
                    if moved < 0.0:
                        self.active[i] = 0.0
                    moved = ti.max(moved, 0.0)
                    excluded += (1.0 - self.active[i]) * ti.select(r > 0.0, part, 0.0)
                    part *= self.active[i]
                x[i] = moved
                self.residual[i] = r
                residual_norm2 += part
            beta = residual_norm2 / ti.max(last, MIN_DIVISOR)
            self.residual_norm2[None] = residual_norm2
            ti.loop_config(serialize=self.traits.light)
            for i in range(n):
                p = self.preconditioned(i, self.residual[i]) + beta * self.direction[i]
                if ti.static(self.projected):
                    p *= self.active[i]
                self.direction[i] = p
            self.scale[None] += reduction  # the part <x, A x> of the scale grows by it
        state = ti.select(excluded > self.residual_norm2[None], ROUND_OVER, CONTINUE)
        small = reductions <= tolerance * tolerance * self.scale[None]
        return ti.select(small, CONVERGED, state)

    @ti.func
    def set_round(self, residual_norm2, scale):
        """Stores <r, r/D> and the scale. The first iteration of a round never ends a solve."""
        self.residual_norm2[None], self.scale[None] = residual_norm2, scale
        self.last_reduction[None] = UNKNOWN_REDUCTION

    @ti.func
    def preconditioned(self, i, r):
        """Returns r/D, or r without a preconditioner."""
        found = r
        if ti.static(self.has_diagonal):
            found = r / ti.max(self.diagonal[i], MIN_DIVISOR)
        return found

    @ti.func
    def _dot(self, a, b):
        """Returns the product of scalars or the dot product of vectors."""
        found = 0.0
        if ti.static(self.is_vector):
            found = a.dot(b)
        else:
            found = a * b
        return found
