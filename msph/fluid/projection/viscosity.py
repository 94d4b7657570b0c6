"""Viscosity of the liquid: explicit where that is stable, otherwise implicit.

The pair forces of viscous_operator.py are equal, opposite and central, so momentum and angular
momentum are kept and rigid rotation is not braked.
"""

import taichi as ti

from msph.fluid.external_forces import ExternalForces
from msph.fluid.particles.particles import Attribute
from msph.fluid.projection.conjugate_gradient import ConjugateGradient
from msph.fluid.projection.discretisation import Discretisation
from msph.fluid.projection.force import Force
from msph.fluid.projection.parameters import ProjectionParameters
from msph.fluid.projection.viscous_operator import STIFFNESS, ViscousOperator
from msph.fluid.small_numbers import MIN_DIVISOR
from msph.launches import data_oriented, kernel

# Largest dt nu STIFFNESS/h^2 of an explicit step. The eigenvalues of lap reach 1.8 STIFFNESS/h^2
# (measured), so no mode overshoots up to 0.55; steps are unstable from 1.1.
MAX_EXPLICIT = 0.5
# Least moment of inertia about an axis over the trace (-).
LEAST_INERTIA = 1e-6
# Error of the implicit solve over the change of the velocities (-), and its iteration limit. Errors
# of a solve that starts at the last change add up from step to step (docs/trials.md, "Forces").
TOLERANCE, MAX_ITERATIONS = 5e-4, 400


@data_oriented
class Viscosity(Force):
    """Force of a dynamic viscosity `viscosity` [Pa s]; with `slip` walls do not brake.

    The implicit step is backward Euler: conjugate gradients on (1 - dt nu lap) u = dt nu lap v for
    the change u of the velocities v, which is symmetric and positive under the volumes V. They
    start at the change of the last step, which is almost the same in slow flow. They have no
    preconditioner, so every iterate keeps the momenta of the start, which are zero. iterations: of
    the last step, 0 if explicit.
    """

    ATTRIBUTES = (
        Attribute("pressure_velocity", "m/s", "by the last step's pressure", 3, carried=False),
        Attribute("viscous_change", "m/s", "of v by viscosity in the last step", 3),
        Attribute("viscous_residual", "m/s", "residual of the viscous solve", 3, carried=False),
        Attribute("viscous_direction", "m/s", "its search direction", 3, carried=False),
        Attribute("viscous_response", "m/s", "operator times direction", 3, carried=False),
        Attribute("wall_friction", "1/m^2", "of walls without slip, over nu", carried=False),
    )

    @staticmethod
    def enabled(parameters: ProjectionParameters) -> bool:
        return parameters.viscosity > 0.0

    def __init__(self, shared: Discretisation):
        super().__init__(shared)
        p, self.iterations = shared.particles, 0
        self.viscous = ViscousOperator(shared, p.viscous_response)
        self.conjugate_gradient = ConjugateGradient(
            shared, self.viscous, p.viscous_residual, p.viscous_direction
        )

    def tune(self, parameters: ProjectionParameters) -> None:
        self.nu = parameters.viscosity / self.layers.rest_density
        self.slip = parameters.slip
        self.stiffness = self.nu * STIFFNESS / self.layers.finest.support**2

    def apply(self, dt: float, external: ExternalForces) -> None:
        """Advances the velocities by dt [s] under viscosity and the last step's pressure.

        Without that pressure viscosity would brake the fall of water at rest on a floor, which the
        pressure solve has yet to stop, and would carry its weight.
        """
        p = self.particles
        n = p.count
        self._add_pressure(n, dt)
        self.iterations = 0
        # Next to walls without slip eigenvalues exceed the bound of MAX_EXPLICIT.
        if self.slip and dt * self.stiffness <= MAX_EXPLICIT:
            self._change_explicitly(n, dt * self.nu)
        else:
            self._remove_rotation(n)
            self.iterations = self.conjugate_gradient.solve(
                p.viscous_change,
                TOLERANCE,
                MAX_ITERATIONS,
                lambda: self.start_round(n, dt * self.nu),
            )
        self._apply_change(n)

    @kernel
    def _add_pressure(self, n: ti.i32, dt: ti.f32):
        """v -= dt/rho0 grad p, with the last step's pressures."""
        p = self.particles
        for i in range(n):
            u = self.operator.displacement(i, p.pressure_multiplier)
            p.pressure_velocity[i] = dt / self.constants.rest_density[None] * u
        ti.loop_config(serialize=self.traits.light)
        for i in range(n):
            p.v[i] += p.pressure_velocity[i]

    @kernel
    def _change_explicitly(self, n: ti.i32, diffusion: ti.f32):
        """u = dt nu lap v, with diffusion = dt nu [m^2]."""
        p = self.particles
        for i in range(n):
            self.viscous.prepare(i)
            p.viscous_change[i] = diffusion * self.viscous.laplacian(i, p.v)

    @kernel
    def _remove_rotation(self, n: ti.i32):
        """Subtracts from u its mean rotation about the centre of the volumes V. The particles have
        moved since the last step, so that u has angular momentum, which iterations reduce but do
        not remove."""
        p = self.particles
        centre, whole = ti.Vector([0.0, 0.0, 0.0]), 0.0
        ti.loop_config(serialize=self.traits.light)
        for i in range(n):
            volume = self.layers.volume[p.layer[i]]
            centre += volume * p.x[i]
            whole += volume
        centre /= ti.max(whole, MIN_DIVISOR)
        moment, inertia = ti.Vector([0.0, 0.0, 0.0]), ti.Matrix.zero(ti.f32, 3, 3)
        ti.loop_config(serialize=self.traits.light)
        for i in range(n):
            volume, r = self.layers.volume[p.layer[i]], p.x[i] - centre
            moment += volume * r.cross(p.viscous_change[i])
            inertia += volume * (r.norm_sqr() * ti.Matrix.identity(ti.f32, 3) - r.outer_product(r))
        # Divided by the trace, since determinants of small numbers underflow. Particles on a line
        # have no inertia about it.
        trace = ti.max(inertia.trace(), MIN_DIVISOR)
        regular = inertia / trace + LEAST_INERTIA * ti.Matrix.identity(ti.f32, 3)
        spin = regular.inverse() @ (moment / trace)
        ti.loop_config(serialize=self.traits.light)
        for i in range(n):
            p.viscous_change[i] -= spin.cross(p.x[i] - centre)

    @kernel
    def start_round(self, n: ti.i32, diffusion: ti.f32):
        """Prepares the operator; sets residual and first direction to dt nu lap (v + u) - u, and
        the scale to <u, dt nu lap v>, which is the squared size of the solution in the norm of the
        operator if u is the solution; diffusion = dt nu [m^2]."""
        p = self.particles
        self.viscous.diffusion[None] = diffusion
        residual_norm2, scale = 0.0, 0.0
        for i in range(n):
            self.viscous.prepare(i)
            u, volume = p.viscous_change[i], self.layers.volume[p.layer[i]]
            r = diffusion * self.viscous.laplacian(i, p.v)
            scale += volume * u.dot(r)
            r += diffusion * self.viscous.laplacian(i, p.viscous_change) - u
            p.viscous_residual[i] = r
            p.viscous_direction[i] = r
            residual_norm2 += volume * r.norm_sqr()
        self.conjugate_gradient.set_round(residual_norm2, ti.max(scale, 0.0))

    @kernel
    def _apply_change(self, n: ti.i32):
        """Adds the change to v, and subtracts the pressure's part. Pair forces cancel, so that the
        sum of the changes is the impulse of the walls."""
        p = self.particles
        ti.loop_config(serialize=self.traits.light)
        for i in range(n):
            change = p.viscous_change[i]
            self.impulses.wall_impulse.add(i, self.layers.mass[p.layer[i]] * change)
            p.v[i] += change - p.pressure_velocity[i]
