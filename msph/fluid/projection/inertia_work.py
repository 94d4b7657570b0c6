"""Impulse and work of the inertial forces of a moving box."""

import taichi as ti

from msph.fluid.external_forces import (
    FIELD_NUMBERS,
    ExternalForces,
    coriolis,
    field_at,
    turning,
)
from msph.fluid.part import Part
from msph.launches import data_oriented, kernel

vec3 = ti.math.vec3


@data_oriented
class InertiaWork(Part):
    """Records impulse and work of the inertial forces in a step.

    In a step, inertia at the centre and centrifugal acceleration have the potential
    -psi = -a.r - |w x r|^2/2, so that their work follows from the positions, like the work of
    gravity; the work of the Euler acceleration follows from the mean velocity. The work on water at
    rest in a moving box is then zero, although velocities change within the step.
    """

    def begin(self, dt: float, external: ExternalForces) -> None:
        """Adds the terms of the work at the beginning of a step of dt [s]."""
        self._add_work(dt, external, -1.0)

    def push(self, dt: float, external: ExternalForces) -> None:
        """Records the impulse, before forces act on the water."""
        if external.moving:
            self._add_impulse(self.particles.count, dt, external.inertial_field())

    def end(self, dt: float, external: ExternalForces) -> None:
        """Adds the terms of the work at the end of the step."""
        self._add_work(dt, external, 1.0)

    def _add_work(self, dt: float, external: ExternalForces, sign: float) -> None:
        if external.moving:
            self._add_half(self.particles.count, dt, sign, external.inertial_field())
            self.boundary.add_inertia_work(dt, external, sign)

    @kernel
    def _add_half(self, n: ti.i32, dt: ti.f32, sign: ti.f32, numbers: FIELD_NUMBERS):
        """Adds m (sign psi + dt/2 v.Euler acceleration) of all particles."""
        p, centre, w = self.particles, 0.5 * self.constants.size[None], turning(numbers)
        a, rise = vec3(numbers[0], numbers[1], numbers[2]), vec3(numbers[6], numbers[7], numbers[8])
        ti.loop_config(serialize=self.traits.light)
        for i in range(n):
            r = p.x[i] - centre
            psi = a.dot(r) + 0.5 * w.cross(r).norm_sqr()
            work = sign * psi - 0.5 * dt * rise.cross(r).dot(p.v[i])
            self.impulses.inertia_work.add(i, self.layers.mass[p.layer[i]] * work)

    @kernel
    def _add_impulse(self, n: ti.i32, dt: ti.f32, numbers: FIELD_NUMBERS):
        p, centre = self.particles, 0.5 * self.constants.size[None]
        ti.loop_config(serialize=self.traits.light)
        for i in range(n):
            a = field_at(p.x[i] - centre, numbers) + coriolis(p.v[i], dt, turning(numbers))
            self.impulses.inertia_impulse.add(i, self.layers.mass[p.layer[i]] * dt * a)
