"""Pressure solve: pressures that remove the compression of the water at the end of a step.

Finds multipliers q >= 0 [m^2] whose displacements u (pressure_operator.py) undo a given
compression: rhs_i + sum V_j (u_i - u_j).grad W_ij <= 0, and = 0 where q > 0. Then v += u/dt and
p = rho0 q/dt^2 (after Bender and Koschier 2015, DFSPH, made conservative for unequal masses).
"""

import taichi as ti

from msph.fluid.external_forces import FIELD_NUMBERS, ExternalForces, field_at
from msph.fluid.particles.particles import Attribute
from msph.fluid.projection.conjugate_gradient import ConjugateGradient
from msph.fluid.projection.discretisation import Discretisation
from msph.fluid.projection.parameters import ProjectionParameters
from msph.fluid.small_numbers import MIN_DIVISOR
from msph.launches import data_oriented, kernel

ATTRIBUTES = (
    Attribute("pressure", "Pa", "a third of the virial stress's trace", view="pressure"),
    Attribute("pressure_multiplier", "Pa", "multiplier q as a pressure, rho0 q/dt^2"),
    Attribute("previous_multiplier", "Pa", "pressure_multiplier of the previous step"),
    Attribute("velocity_multiplier", "m^2", "unknown q of the pressure solve", carried=False),
    Attribute(
        "predicted_density", "kg/m^3", "density after the position correction", carried=False
    ),
    Attribute("rhs", "-", "compression that the pressure solve must undo", carried=False),
    Attribute("residual", "-", "compression left by the pressure solve", carried=False),
    Attribute("direction", "m^2", "search direction of the pressure solve", carried=False),
    Attribute("active", "-", "1 where the pressure solve may change q", carried=False),
)

# Density deficit (-) that may close in full within a step. A smaller deficit closes in part: water
# that falls into it carries no weight meanwhile (pressures of a deep pool were up to 8 % too low).
GAP_DEFICIT = 0.003
# Largest factor (-) that scales the initial guess. The least is 0, so that no impulse remains that
# this step does not need.
MAX_START_SCALE = 2.0
# Ratio (-) of its diagonal to the diagonal that it would have if it moved, below which a particle
# of prescribed velocity has no multiplier.
MIN_HELD_DIAGONAL = 0.1
# Least diagonal, times the squared spacing (-), of a particle with an initial guess; it is 0.8 in
# bulk. The first step of a particle that has lost its neighbours would be its residual over 0.
MIN_DIAGONAL = 1e-6
# Smallest displacement in the scale of the tolerance, in spacings: keeps the tolerance above zero.
MIN_DISPLACEMENT = 1e-5


@data_oriented
class PressureSolve(Discretisation):
    """Solver of the multipliers q by projected conjugate gradients, and their effect on velocities.

    velocity_multiplier holds q; residual, direction and active are fields of the conjugate
    gradients. settling and pair_spacing are set by Adaptation and Density.
    """

    parameters: ProjectionParameters

    def __init__(self, shared: Discretisation):
        super().__init__(shared)
        p = self.particles
        self.conjugate_gradient = ConjugateGradient(
            shared, shared.operator, p.residual, p.direction, diagonal=p.diagonal, active=p.active
        )

    @kernel
    def build_rhs(self, n: ti.i32, dt: ti.f32):
        """rhs_i = dt dc/dt + share (c_i - 1), with c_i - 1 = Density.excess() plus the compression
        by the position correction. Sets the initial guess q = dt^2 p/rho0, p the mean multiplier of
        two steps, since they alternate, and predicted_density, without the air share.

        share is dt/release for an excess. For a deficit it rises with the deficit, to 1 at
        GAP_DEFICIT.
        """
        p = self.particles
        for i in range(n):
            rate, closing = self.operator.divergences(i, (p.v, p.position_correction))
            if ti.static(self.traits.bodies):
                rate += self.links.rate_by_bodies(i)
            excess, after = self.density.excess(i) + closing, self.density.relative(i) + closing
            p.predicted_density[i] = self.constants.rest_density[None] * after
            if after < self.constants.spray[None]:
                rate = ti.min(rate, 0.0)
            share = ti.max(dt / self.constants.release[None], -excess / GAP_DEFICIT)
            removed = ti.min(share, 1.0) * excess
            # Halves of a split are crowded until the position correction has moved them apart.
            # No multiplier moves particles of prescribed velocities apart.
            held = p.settling[i] > 0 or p.prescribed[i] > 0
            removed = ti.select(held and excess > 0.0, 0.0, removed)
            p.rhs[i] = dt * rate + removed
            last = p.pressure_multiplier[i]
            start = 0.5 * (last + p.previous_multiplier[i])
            p.previous_multiplier[i] = last
            reached = p.diagonal[i] * self.layers.spacing[p.layer[i]] ** 2 > MIN_DIAGONAL
            start = ti.select(reached, start, 0.0)
            p.velocity_multiplier[i] = start * dt * dt / self.constants.rest_density[None]

    def solve(self, dt: float) -> int:
        """Solves for the multipliers of a step of dt [s]; returns the number of iterations."""
        limits = self.parameters
        motion_weight = limits.motion_tolerance / limits.tolerance
        return self.solve_to(dt, limits.tolerance, motion_weight, limits.velocity_iterations)

    def solve_to(
        self, dt: float, tolerance: float, motion_weight: float, max_iterations: int
    ) -> int:
        """Solves from the velocity multipliers for the rhs; returns the number of iterations.

        The error may be `tolerance` (-) of the displacements' root mean square. The particles'
        motion within dt [s], relative to their mean motion, counts as `motion_weight` (-) times a
        displacement: fast water allows a larger error, which saves half the iterations.
        """
        n = self.particles.count
        self.links.add_to_diagonal()
        if self.openings.all:
            self._hold(n)
        return self.conjugate_gradient.solve(
            self.particles.velocity_multiplier,
            tolerance,
            max_iterations,
            lambda: self.start_round(n, dt, motion_weight),
        )

    @kernel
    def _hold(self, n: ti.i32):
        """Excludes particles of prescribed velocity that hardly reach moving particles: multipliers
        do not displace them, and their own multipliers would be large and converge slowly.

        The diagonal of such a row is V_i sum V_j |grad W_ij|^2 over the neighbours that move.
        """
        p = self.particles
        for i in range(n):
            if p.prescribed[i] > 0:
                volume, found = self.layers.volume[p.layer[i]], 0.0
                for s in range(self.neighbours.start[i], self.neighbours.end[i]):
                    j = self.neighbours.index[s]
                    square = self.layers.per_volume[p.layer[j]] * self.pair_gradient[s].norm_sqr()
                    found += ti.select(p.prescribed[j] > 0, 0.0, volume * square)
                if found < MIN_HELD_DIAGONAL * p.diagonal[i]:
                    p.rhs[i], p.velocity_multiplier[i] = -1.0, 0.0

    @kernel
    def start_round(self, n: ti.i32, dt: ti.f32, motion_weight: ti.f32):
        """Scales q by <q, rhs>/<q, A q>, which minimises its error in the norm of A; sets
        r = rhs - A q, the active particles, the first direction r/D, <r, r/D> and the scale.

        Without the scaling whole columns rise and fall by less than the tolerance.
        """
        p = self.particles
        product, against_rhs = self.operator.apply(n, p.velocity_multiplier), 0.0
        for i in range(n):
            volume = self.layers.volume[p.layer[i]]
            against_rhs += volume * p.velocity_multiplier[i] * p.rhs[i]
        factor = 1.0
        if product > MIN_DIVISOR:
            factor = ti.math.clamp(against_rhs / product, 0.0, MAX_START_SCALE)
        residual_norm2, scale, total, square = 0.0, 0.0, 0.0, 0.0
        # Numbers, not a vector, to which all threads of a GPU would add one by one (sums.py).
        drift_x, drift_y, drift_z = 0.0, 0.0, 0.0
        for i in range(n):
            layer = p.layer[i]
            volume, spacing = self.layers.volume[layer], self.layers.spacing[layer]
            q = factor * p.velocity_multiplier[i]
            r = p.rhs[i] - factor * self.operator.response(i, p.velocity_multiplier)
            active = ti.select(q > 0.0 or r > 0.0, 1.0, 0.0)
            direction = active * self.conjugate_gradient.preconditioned(i, r)
            p.velocity_multiplier[i], p.residual[i] = q, r
            p.active[i], p.direction[i] = active, direction
            residual_norm2 += volume * r * direction
            u = factor * p.displacement[i]
            motion = dt * p.v[i] + u
            scale += volume * (u.norm_sqr() + (MIN_DISPLACEMENT * spacing) ** 2)
            total += volume
            square += volume * motion.norm_sqr()
            drift_x += volume * motion.x
            drift_y += volume * motion.y
            drift_z += volume * motion.z
        # Relative to the mean motion: a falling drop is solved as strictly as a drop at rest.
        drift = ti.Vector([drift_x, drift_y, drift_z])
        relative = ti.max(square - drift.norm_sqr() / total, 0.0)
        self.conjugate_gradient.set_round(residual_norm2, scale + motion_weight**2 * relative)

    def accelerate(self, dt: float, external: ExternalForces) -> float:
        """Sets v += u/dt, p = rho0 q/dt^2, the virial pressure and, for shear relief, the stress.

        Returns the largest rate [1/s] by which pressure bounds the next step: sqrt(p/rho0) over
        pressure_cfl spacings.
        """
        n, field = self.particles.count, external.field()
        rate = self._accelerate(n, dt, field, self.density.with_stress)
        self.links.record(dt)
        self.contact.push_moving()
        return rate

    @kernel
    def _accelerate(
        self, n: ti.i32, dt: ti.f32, field: FIELD_NUMBERS, with_stress: ti.template()
    ) -> ti.f32:
        p, top, rest_density = self.particles, 0.0, self.constants.rest_density[None]
        centre = 0.5 * self.constants.size[None]
        ti.loop_config(serialize=self.traits.light)
        for i in range(n):
            p.pressure_multiplier[i] = rest_density * p.velocity_multiplier[i] / (dt * dt)
        for i in range(n):
            m = self.layers.mass[p.layer[i]]
            found = self.virial.evaluate(i, field_at(p.x[i] - centre, field), with_stress)
            inner, wall = found.inner, found.wall
            self.impulses.record_internal(i, m, p.x[i], dt * inner)
            self.impulses.wall_impulse.add(i, m * dt * wall)
            p.v[i] += dt * (inner + wall)
            p.pressure[i] = found.virial
            if ti.static(with_stress):
                p.normal_stress[i], p.shear_stress[i] = found.normal, found.shear
            wave = ti.sqrt(ti.max(found.virial, 0.0) / rest_density)
            ti.atomic_max(top, wave / (self.constants.pressure_cfl[None] * p.pair_spacing[i]))
        return top
