"""The pressure solve: multipliers q >= 0 whose displacements undo a given compression."""

import taichi as ti

from msph.fluid.layers import Layers
from msph.fluid.neighbours import NeighbourList
from msph.fluid.particles import Attribute, Particles

# What a solve reads and leaves on the particles.
ATTRIBUTES = (
    Attribute("source", "-", "compression that a solve must undo", carried=False),
    Attribute("gradient", "1/m", "sum V_j grad W_ij and the walls' part", width=3, carried=False),
    Attribute("wall", "1/m", "gradient of the walls' part of c", width=3, carried=False),
    Attribute("diagonal", "1/m^2", "diagonal of the solves' operator", carried=False),
    Attribute("shift", "m", "displacement by a solve", width=3, carried=False),
    Attribute("residual", "-", "compression left by a solve", carried=False),
    Attribute("direction", "m^2", "search direction of a solve", carried=False),
    Attribute("response", "-", "compression that the direction undoes", carried=False),
)

# Keeps divisions by what may vanish finite; far below any diagonal [1/m^2] or curvature met.
TINY = 1e-30
# Iterations between looks at the error, which wait for the device.
LOOK = 3


@ti.data_oriented
class PressureSolve:
    """Projected conjugate gradients.

    Finds q >= 0 [m^2] and u_i = -(q_i g_i + sum V_j q_j grad W_ij) [m], with
    g_i = sum V_j grad W_ij + grad lambda_i, so that
    source_i + sum V_j (u_i - u_j).grad W_ij + u_i.grad lambda_i <= 0, and = 0 where q > 0.
    Divergence and gradient are adjoint, so the operator A is symmetric and positive under the
    weights V. slope holds V_j dW/dr / r [1/m^2] of each entry of the neighbour list.

    Stops when no particle's error exceeds `tolerance` times the largest source, nor `residual`
    (-). A mean would not do: while a deep column falls only its lowest particles are compressed,
    and under-converged it explodes. restart: iterations of a round.
    """

    def __init__(
        self,
        layers: Layers,
        particles: Particles,
        neighbours: NeighbourList,
        slope: ti.Field,
        tolerance: float,
        residual: float,
        restart: int,
    ):
        self.layers, self.particles = layers, particles
        self.neighbours, self.slope = neighbours, slope
        self.tolerance, self.residual, self.restart = tolerance, residual, restart
        self.largest_source = ti.field(ti.f32, shape=())
        self.error_max = ti.field(ti.f32, shape=())
        self.descent = ti.field(ti.f32, shape=())
        self.last_descent = ti.field(ti.f32, shape=())
        self.curvature = ti.field(ti.f32, shape=())

    def run(self, multiplier, most: int) -> int:
        """Improves the multipliers (capacity,) [m^2] in place and leaves their shifts; returns the
        iterations it took, at most `most`.

        Within a round the particles that push are fixed: those with q > 0 or compressed. A round
        begins anew from the true residual, so what clamping at q = 0 breaks is mended there.
        """
        n, p = self.particles.count, self.particles
        taken = 0
        while taken < most:
            self.find_shifts(n, multiplier)
            self.begin(n, multiplier, taken == 0)
            bound = max(self.tolerance * self.largest_source[None], self.residual)
            if self.error_max[None] < bound:
                break
            for k in range(min(self.restart, most - taken)):
                self.find_shifts(n, p.direction)
                self.respond(n)
                self.descend(n, multiplier)
                self.turn(n)
                taken += 1
                if k % LOOK == LOOK - 1 and self.error_max[None] < 0.5 * bound:
                    break
        self.find_shifts(n, multiplier)
        return taken

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
    def divergence(self, i, field: ti.template()):
        """sum V_j (u_i - u_j).grad W_ij + u_i.grad lambda_i of a vector field u [u's unit / m]."""
        u = field[i]
        found = u.dot(self.particles.wall[i])
        for s in range(self.neighbours.start[i], self.neighbours.end[i]):
            j = self.neighbours.index[s]
            r_ij = self.particles.x[i] - self.particles.x[j]
            found += self.slope[s] * (u - field[j]).dot(r_ij)
        return found

    @ti.kernel
    def begin(self, n: ti.i32, q: ti.template(), first: ti.i32):
        """r = source - A q where particles push, 0 elsewhere; first direction r/D."""
        self.descent[None] = 0.0
        self.error_max[None] = 0.0
        if first == 1:
            self.largest_source[None] = 0.0
        for i in range(n):
            r = self.particles.source[i] + self.divergence(i, self.particles.shift)
            d = ti.max(self.particles.diagonal[i], TINY)
            # Compression left, and also expansion where a multiplier still pushes: both are error.
            ti.atomic_max(self.error_max[None], abs(ti.max(q[i] + r / d, 0.0) - q[i]) * d)
            ti.atomic_max(self.largest_source[None], self.particles.source[i])
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
            response = -self.divergence(i, self.particles.shift)
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
