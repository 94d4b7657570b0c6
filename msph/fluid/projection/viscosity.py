"""Viscosity of the liquid: explicit where the step allows it, else implicit.

The forces are those of viscous_operator: equal, opposite and central, so momentum and angular
momentum are kept, and water that turns as one is not braked.
"""

import math

import taichi as ti

from msph.fluid.external_forces import ExternalForces
from msph.fluid.particles.particles import Attribute
from msph.fluid.projection.conjugate_gradient import ConjugateGradient
from msph.fluid.projection.discretisation import Discretisation
from msph.fluid.projection.parameters import ProjectionParameters
from msph.fluid.projection.viscous_operator import STIFFNESS, ViscousOperator
from msph.taichi_internals import data_oriented, kernel

# Largest dt nu STIFFNESS/h^2 of an explicit step. Eigenvalues of lap reach 1.8 STIFFNESS/h^2
# (measured), so up to .55 no mode overshoots, and from 1.1 on it explodes.
EXPLICIT = 0.5
# Share of the velocities' change that the implicit solve may leave, and its most iterations.
TOLERANCE, MOST = 1e-3, 400


@data_oriented
class Viscosity:
    """Applies a dynamic viscosity `viscosity` [Pa s] to the velocities; slip: walls do not brake.

    The step is explicit where that is stable, else backward Euler: conjugate gradients on
    (1 - dt nu lap) v = v*, symmetric and positive under the volumes V. They have no preconditioner:
    so every iterate keeps momenta. iterations counts those of the last step, 0 if explicit.
    """

    ATTRIBUTES = (
        Attribute("pressure_velocity", "m/s", "by the last step's pressure", 3, carried=False),
        Attribute("viscous_residual", "m/s", "change by viscosity yet to come", 3, carried=False),
        Attribute("viscous_direction", "m/s", "its search direction", 3, carried=False),
        Attribute("viscous_response", "m/s", "operator times direction", 3, carried=False),
    )

    @staticmethod
    def wanted(parameters: ProjectionParameters) -> bool:
        return parameters.viscosity > 0.0

    def __init__(self, shared: Discretisation):
        p = shared.particles
        self.layers, self.particles, self.pressure = shared.layers, p, shared.operator
        self.constants = shared.constants
        self.operator = ViscousOperator(
            shared.constants, shared.layers, p, shared.neighbours, p.viscous_response
        )
        self.gradients = ConjugateGradient(
            shared.layers,
            p,
            self.operator,
            residual=p.viscous_residual,
            direction=p.viscous_direction,
        )
        self.longest_step = math.inf
        self.iterations = 0

    def tune(self, parameters: ProjectionParameters) -> None:
        self.nu = parameters.viscosity / self.layers.rest_density
        self.stiffness = self.nu * STIFFNESS / self.layers.finest.support**2

    def apply(self, dt: float, external: ExternalForces) -> None:
        """Velocities after dt [s] of viscosity.

        The last step's pressure acts meanwhile. Without it viscosity would brake the fall of water
        at rest on its floor, which the pressure has yet to stop, and bear its weight.
        """
        p = self.particles
        n = p.count
        self.add_pressure(n, dt)
        self.iterations = 0
        explicit = dt * self.stiffness <= EXPLICIT
        if explicit:
            self.begin(n, dt * self.nu)
        else:
            self.iterations = self.gradients.solve(
                p.v, TOLERANCE, MOST, lambda: self.begin(n, dt * self.nu)
            )
        self.take_pressure(n, float(explicit))

    @kernel
    def add_pressure(self, n: ti.i32, dt: ti.f32):
        """v -= dt/rho0 grad p of the last step's pressures."""
        p = self.particles
        for i in range(n):
            u = self.pressure.displacement(i, p.pressure_multiplier)
            p.pressure_velocity[i] = dt / self.constants.rest_density[None] * u
        for i in range(n):
            p.v[i] += p.pressure_velocity[i]

    @kernel
    def begin(self, n: ti.i32, span: ti.f32):
        """r = dt nu lap v, which is also the first direction; span = dt nu [m^2]."""
        p = self.particles
        self.operator.span[None] = span
        descent = 0.0
        for i in range(n):
            r = span * self.operator.laplacian(i, p.v)
            p.viscous_residual[i] = r
            p.viscous_direction[i] = r
            descent += self.layers.volume[p.layer[i]] * r.norm_sqr()
        self.gradients.begin_round(descent, 0.0)

    @kernel
    def take_pressure(self, n: ti.i32, explicit: ti.f32):
        """v less the pressure's part; explicit: times r = dt nu lap v is added."""
        p = self.particles
        for i in range(n):
            p.v[i] += explicit * p.viscous_residual[i] - p.pressure_velocity[i]
