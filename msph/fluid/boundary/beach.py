"""Beaches: zones at the ends of the box in which waves die out."""

from collections.abc import Sequence
from dataclasses import dataclass

import taichi as ti

from msph.fluid.part import Part, Parts
from msph.launches import data_oriented, kernel

# Kernel argument: numbers of the six walls, those at the origin first.
WALL_NUMBERS = ti.types.vector(6, ti.f32)


@dataclass(frozen=True)
class Beach:
    """Zone of `length` [m] before a wall, 0 to 2 at the origin and 3 to 5 opposite, in which
    velocities decay at the rate r (1 - s/length)^2 at the distance s from the wall; rate r
    [1/s]."""

    wall: int
    length: float
    rate: float


@data_oriented
class Beaches(Part):
    """The beaches of a scene. Their impulse and work count as those of walls."""

    def __init__(self, parts: Parts):
        super().__init__(parts)
        self.load(())

    def load(self, beaches: Sequence[Beach]) -> None:
        """Takes the beaches of a scene, at most one per wall."""
        self.given = bool(beaches)
        self._per_length, self._rates = [0.0] * 6, [0.0] * 6
        for beach in beaches:
            self._per_length[beach.wall] = 1.0 / beach.length
            self._rates[beach.wall] = beach.rate
        if self.given:
            self._damp(0, 0.0, self._per_length, self._rates)

    def damp(self, dt: float) -> None:
        """Damps the water for dt [s]."""
        if self.given:
            self._damp(self.particles.count, dt, self._per_length, self._rates)

    @kernel
    def _damp(self, n: ti.i32, dt: ti.f32, per_length: WALL_NUMBERS, rates: WALL_NUMBERS):
        """v *= exp(-dt r q^2), stable for any step."""
        p, size = self.particles, self.constants.size[None]
        for i in range(n):
            x, v, rate = p.x[i], p.v[i], 0.0
            for k in ti.static(range(3)):
                near = ti.max(1.0 - x[k] * per_length[k], 0.0)
                far = ti.max(1.0 - (size[k] - x[k]) * per_length[3 + k], 0.0)
                rate = ti.max(rate, ti.max(rates[k] * near * near, rates[3 + k] * far * far))
            change = (ti.exp(-dt * rate) - 1.0) * v
            m = self.layers.mass[p.layer[i]]
            self.impulses.wall_impulse.add(i, m * change)
            self.impulses.wall_work.add(i, m * change.dot(v + 0.5 * change))
            p.v[i] = v + change
