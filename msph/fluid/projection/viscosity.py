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
from msph.launches import data_oriented, kernel

# Largest dt nu STIFFNESS/h^2 of an explicit step. The eigenvalues of lap reach 1.8 STIFFNESS/h^2
# (measured), so no mode overshoots up to 0.55; steps are unstable from 1.1.
MAX_EXPLICIT = 0.5
# Error of the implicit solve over the change of the velocities (-), and its iteration limit.
TOLERANCE, MAX_ITERATIONS = 4e-3, 400


@data_oriented
class Viscosity(Force):
    """Force of a dynamic viscosity `viscosity` [Pa s]; with `slip` walls do not brake.

    The implicit step is backward Euler: conjugate gradients on (1 - dt nu lap) v = v*, which is
    symmetric and positive under the volumes V. They have no preconditioner, so every iterate keeps
    the momenta. iterations: of the last step, 0 if explicit.
    """

    ATTRIBUTES = (
        Attribute("pressure_velocity", "m/s", "by the last step's pressure", 3, carried=False),
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
        p, self.pressure, self.iterations = shared.particles, shared.operator, 0
        self.operator = ViscousOperator(shared, self.density.pair_gradient, p.viscous_response)
        self.conjugate_gradient = ConjugateGradient(
            shared, self.operator, p.viscous_residual, p.viscous_direction
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
        explicit = self.slip and dt * self.stiffness <= MAX_EXPLICIT
        if explicit:
            self.start_round(n, dt * self.nu)
        else:
            self.iterations = self.conjugate_gradient.solve(
                p.v, TOLERANCE, MAX_ITERATIONS, lambda: self.start_round(n, dt * self.nu)
            )
        self._remove_pressure(n, float(explicit))

    @kernel
    def _add_pressure(self, n: ti.i32, dt: ti.f32):
        """v -= dt/rho0 grad p, with the last step's pressures."""
        p = self.particles
        for i in range(n):
            u = self.pressure.displacement(i, p.pressure_multiplier)
            p.pressure_velocity[i] = dt / self.constants.rest_density[None] * u
        ti.loop_config(serialize=self.traits.light)
        for i in range(n):
            p.v[i] += p.pressure_velocity[i]

    @kernel
    def start_round(self, n: ti.i32, diffusion: ti.f32):
        """Prepares the operator; sets residual and first direction to dt nu lap v, with diffusion =
        dt nu [m^2]."""
        p = self.particles
        self.operator.diffusion[None] = diffusion
        residual_norm2 = 0.0
        for i in range(n):
            self.operator.prepare(i)
            r = diffusion * self.operator.laplacian(i, p.v)
            p.viscous_residual[i] = r
            p.viscous_direction[i] = r
            residual_norm2 += self.layers.volume[p.layer[i]] * r.norm_sqr()
        self.conjugate_gradient.set_round(residual_norm2, 0.0)

    @kernel
    def _remove_pressure(self, n: ti.i32, explicit: ti.f32):
        """Subtracts the pressure's part from v; adds `explicit` times the residual."""
        p = self.particles
        ti.loop_config(serialize=self.traits.light)
        for i in range(n):
            p.v[i] += explicit * p.viscous_residual[i] - p.pressure_velocity[i]
