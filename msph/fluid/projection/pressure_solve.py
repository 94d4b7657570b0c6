"""The velocity solve: pressures that leave the water without compression at the end of a step.

Finds multipliers q >= 0 [m^2] whose displacements u (see pressure_operator) undo a given
compression: rhs_i + sum V_j (u_i - u_j).grad W_ij <= 0, and = 0 where q > 0. Then v += u/dt and
p = rho0 q/dt^2 (after Bender and Koschier 2015, DFSPH, made conservative for unequal masses).
"""

import taichi as ti

from msph.fluid.particles.particles import Attribute
from msph.fluid.projection.conjugate_gradient import TINY, ConjugateGradient
from msph.fluid.projection.discretisation import Discretisation
from msph.fluid.projection.parameters import ProjectionParameters
from msph.fluid.projection.virial_pressure import VirialPressure
from msph.taichi_internals import data_oriented, kernel

ATTRIBUTES = (
    Attribute("pressure", "Pa", "a third of the virial stress's trace", view="pressure"),
    Attribute("pressure_multiplier", "Pa", "of the velocity solve: pairs press with the mean"),
    Attribute("previous_multiplier", "Pa", "pressure_multiplier of the step before"),
    Attribute("velocity_multiplier", "m^2", "unknown of the velocity solve", carried=False),
    Attribute("predicted_density", "kg/m^3", "once positions are corrected", carried=False),
    Attribute("rhs", "-", "compression that the velocity solve must undo", carried=False),
    Attribute("residual", "-", "compression that it has left", carried=False),
    Attribute("direction", "m^2", "its search direction", carried=False),
    Attribute("active", "-", "1 where it may change the multiplier", carried=False),
)

# Deficit of density (-) from which on water may fall together within a step. Slighter ones are the
# position correction's: water that falls into them bears no weight meanwhile.
GAP = 0.003
# Bounds (-) of the factor by which the start of a solve is scaled; beyond them it is no guess.
LEAST_SCALED, MOST_SCALED = 0.5, 2.0
# Displacement, in spacings, that counts as none: a share of it is left even by the best stop.
NO_DISPLACEMENT = 1e-5


@data_oriented
class PressureSolve:
    """Solves for the velocities of one fluid."""

    parameters: ProjectionParameters

    def __init__(self, shared: Discretisation):
        p = shared.particles
        self.constants, self.layers, self.particles = shared.constants, shared.layers, p
        self.contact = shared.contact
        self.density, self.operator = shared.density, shared.operator
        self.impulses = shared.impulses
        self.gradients = ConjugateGradient(
            shared.layers,
            p,
            shared.operator,
            residual=p.residual,
            direction=p.direction,
            diagonal=p.diagonal,
            active=p.active,
        )
        self.virial = VirialPressure(shared.layers, p, shared.neighbours, shared.density)

    def solve(self, dt: float) -> int:
        """Multipliers for a step of dt [s] after build_rhs(); returns the iterations it took."""
        limits = self.parameters
        leeway = limits.motion_tolerance / limits.tolerance
        return self.converge(dt, limits.tolerance, leeway, limits.velocity_iterations)

    @kernel
    def build_rhs(self, n: ti.i32, dt: ti.f32):
        """rhs_i = dt dc/dt + share (c_i - 1), c_i as it will be once positions are corrected; and
        velocity multipliers q = dt^2 p/rho0 to start from.

        share is 1 for gaps, and dt/release for what is crowded or hardly thinner than rest. The
        start is the mean of two steps: pressures swing from one to the next.
        """
        p = self.particles
        for i in range(n):
            rate, closing = self.operator.divergences(i, p.v, p.position_correction)
            rate += p.boundary_inflow[i]
            c = self.density.excess(i) + closing
            p.predicted_density[i] = self.constants.rest_density[None] * (1.0 + c)
            if 1.0 + c < self.constants.spray[None]:
                rate = ti.min(rate, 0.0)
            share = ti.max(dt / self.constants.release[None], -c / GAP)
            wanted = ti.min(share, 1.0) * c
            # Halves of a split are crowded until positions have been corrected.
            wanted = ti.select(p.settling[i] > 0 and c > 0.0, 0.0, wanted)
            p.rhs[i] = dt * rate + wanted
            now = p.pressure_multiplier[i]
            start = 0.5 * (now + p.previous_multiplier[i])
            p.previous_multiplier[i] = now
            p.velocity_multiplier[i] = start * dt * dt / self.constants.rest_density[None]

    def accelerate(self, dt: float, gravity: tuple[float, float, float], stressed: bool) -> float:
        """v += u/dt, p = rho0 q/dt^2, the virial pressure and, if `stressed`, the virial stress.
        Returns the largest rate [1/s] by which pressure bounds the next step: sqrt(p/rho0) over
        pressure_cfl spacings."""
        n = self.particles.count
        rate = self._accelerate(n, dt, gravity, stressed)
        if self.contact.boundary.count:
            self._read_beside_bodies(n, gravity)
        return rate

    def converge(self, dt: float, tolerance: float, leeway: float, most: int) -> int:
        """Solves from the velocity multipliers for the rhs; returns the iterations it took.

        To within the share `tolerance` of the displacements' root mean square. The way that
        particles go in the step of dt [s], less their mean, counts as `leeway` (-) times a
        displacement: in still water every error stirs it, in a dam break one of a hundredth of its
        speed is lost, and takes half the iterations.
        """
        n = self.particles.count
        return self.gradients.solve(
            self.particles.velocity_multiplier,
            tolerance,
            most,
            lambda: self.begin(n, dt, leeway),
        )

    @kernel
    def begin(self, n: ti.i32, dt: ti.f32, leeway: ti.f32):
        """q scaled to the least <q - x, A (q - x)> from the solution x, by <q, rhs>/<q, A q>;
        r = rhs - A q, first direction r/D where particles are active, scale and descent.

        Without the scaling, whole columns rise and fall by less than any tolerance sees.
        """
        p = self.particles
        given, asked = self.operator.apply(n, p.velocity_multiplier), 0.0
        for i in range(n):
            asked += self.layers.volume[p.layer[i]] * p.velocity_multiplier[i] * p.rhs[i]
        scaled = 1.0
        if given > TINY:
            scaled = ti.math.clamp(asked / given, LEAST_SCALED, MOST_SCALED)
        descent, scale, whole, square, drift = 0.0, 0.0, 0.0, 0.0, ti.Vector([0.0, 0.0, 0.0])
        for i in range(n):
            layer = p.layer[i]
            volume, spacing = self.layers.volume[layer], self.layers.spacing[layer]
            q = scaled * p.velocity_multiplier[i]
            r = p.rhs[i] - scaled * self.operator.response(i, p.velocity_multiplier)
            active = ti.select(q > 0.0 or r > 0.0, 1.0, 0.0)
            direction = active * self.gradients.preconditioned(i, r)
            p.velocity_multiplier[i], p.residual[i] = q, r
            p.active[i], p.direction[i] = active, direction
            descent += volume * r * direction
            u = scaled * p.displacement[i]
            way = dt * p.v[i] + u
            scale += volume * (u.norm_sqr() + (NO_DISPLACEMENT * spacing) ** 2)
            whole += volume
            square += volume * way.norm_sqr()
            drift += volume * way
        # Less the way that all water goes together: a drop that falls fast is no less round.
        apart = ti.max(square - drift.norm_sqr() / whole, 0.0)
        self.gradients.begin_round(descent, scale + leeway**2 * apart)

    @kernel
    def _accelerate(
        self, n: ti.i32, dt: ti.f32, gravity: ti.math.vec3, stressed: ti.template()
    ) -> ti.f32:
        p, top = self.particles, 0.0
        for i in range(n):
            p.pressure_multiplier[i] = (
                self.constants.rest_density[None] * p.velocity_multiplier[i] / (dt * dt)
            )
        for i in range(n):
            m, rest_density = self.layers.mass[p.layer[i]], self.constants.rest_density[None]
            pressed = self.virial.pressed(i, gravity, stressed)
            inner, wall = pressed.inner, pressed.wall
            # Only beside bodies: sums of zeros would cost a third of this loop.
            if p.boundary_gradient[i].norm_sqr() > 0.0:
                body = -p.pressure_multiplier[i] / rest_density * p.boundary_gradient[i]
                wall += body
                self.impulses.body_impulse[None] += m * dt * body
                # Force of the bodies on the particle times their velocity.
                work = m * p.velocity_multiplier[i] / dt * p.boundary_inflow[i]
                self.impulses.wall_work[None] += work
            self.impulses.record_internal(m, p.x[i], dt * inner)
            self.impulses.wall_impulse[None] += m * dt * wall
            p.v[i] += dt * (inner + wall)
            p.pressure[i] = pressed.virial
            if ti.static(stressed):
                p.normal_stress[i], p.shear_stress[i] = pressed.normal, pressed.shear
            swing = ti.sqrt(ti.max(pressed.virial, 0.0) / rest_density)
            ti.atomic_max(top, swing / (self.constants.pressure_cfl[None] * p.pair_spacing[i]))
        return top

    @kernel
    def _read_beside_bodies(self, n: ti.i32, gravity: ti.math.vec3):
        """The pressure of particles whose kernels reach a body."""
        for i in range(n):
            if self.particles.boundary_gradient[i].norm_sqr() > 0.0:
                self.particles.pressure[i] = self.virial.beside_body(i, gravity)
