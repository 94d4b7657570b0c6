"""Impulse and work of the inertial forces of a moving box."""

import taichi as ti

from msph.fluid.external_forces import (
    FIELD_NUMBERS,
    ExternalForces,
    coriolis,
    field_at,
    turning,
)
from msph.fluid.parts import Parts
from msph.taichi_internals import data_oriented, kernel


@data_oriented
class InertiaWork:
    """Records the impulse m dt a and the work m dt a.v of the inertial forces in a step.

    v is the mean of the velocities at the beginning and at the end of the step: the work on water
    at rest in an accelerated box is then zero, although velocities change within the step.
    """

    def __init__(self, parts: Parts):
        self.constants, self.layers, self.particles = parts.constants, parts.layers, parts.particles
        self.floating, self.impulses = parts.boundary.floating, parts.impulses

    def begin(self, dt: float, external: ExternalForces) -> None:
        """Records the impulse, and the first half of the work, before forces act on the water."""
        if external.moving:
            self._record(self.particles.count, dt, 1.0, external.inertial_field())

    def end(self, dt: float, external: ExternalForces) -> None:
        """Records the second half of the work, and that on floating bodies, after all forces."""
        if external.moving:
            self._record(self.particles.count, dt, 0.0, external.inertial_field())
            self.floating.add_inertia_work(0.5 * dt)

    @kernel
    def _record(self, n: ti.i32, dt: ti.f32, share: ti.f32, numbers: FIELD_NUMBERS):
        """Adds half of the work in dt [s], and a share (-) of the impulse."""
        p, centre = self.particles, 0.5 * self.constants.size[None]
        for i in range(n):
            m, v = self.layers.mass[p.layer[i]], p.v[i]
            a = field_at(p.x[i] - centre, numbers)
            self.impulses.inertia_work[None] += 0.5 * m * dt * a.dot(v)
            whole = a + coriolis(v, dt, turning(numbers))
            self.impulses.inertia_impulse[None] += share * m * dt * whole
