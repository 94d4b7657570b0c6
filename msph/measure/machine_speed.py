"""How fast this machine computes what water consists of: sums over neighbours."""

import platform
import time

import numpy as np
import taichi as ti

from msph import user_cache
from msph.taichi_internals import data_oriented, kernel

# Particles and neighbours of each, about those of a splash; and how far away in memory these lie.
PARTICLES, NEIGHBOURS, SPREAD = 4096, 48, 400
# Sums in a round, so that it lasts milliseconds, and rounds: the fastest is least disturbed.
SUMS, ROUNDS = 20, 8
# Starts that measure before the fastest is believed: other programs may disturb some.
STARTS = 5


@data_oriented
class NeighbourSum:
    """Sums over neighbours at random places nearby."""

    def __init__(self) -> None:
        rng = np.random.default_rng(0)
        entries = PARTICLES * NEIGHBOURS
        own = np.arange(entries) // NEIGHBOURS
        found = (own + rng.integers(-SPREAD, SPREAD, entries)) % PARTICLES
        self.index = ti.field(ti.i32, shape=entries)
        self.x = ti.Vector.field(3, ti.f32, shape=PARTICLES)
        self.total = ti.field(ti.f32, shape=PARTICLES)
        self.index.from_numpy(found.astype(np.int32))
        self.x.from_numpy(rng.random((PARTICLES, 3), dtype=np.float32))

    @kernel
    def sum(self):
        for i in range(PARTICLES):
            total = 0.0
            for k in range(NEIGHBOURS):
                r = self.x[i] - self.x[self.index[i * NEIGHBOURS + k]]
                total += 1.0 / (1.0 + r.norm_sqr())
            self.total[i] = total


def machine_speed(arch: str) -> float:
    """Neighbours summed per second [1/s] on the architecture that Taichi runs on: the fastest of
    the first STARTS starts on this machine, which are remembered."""
    key = f"neighbours per second on {arch} of {platform.node()}"
    known = user_cache.recall(key, [])
    if len(known) < STARTS:
        known = [*known, measured_speed()]
        user_cache.remember(key, known)
    return float(max(known))


def measured_speed() -> float:
    """The same, measured now; takes a tenth of a second."""
    neighbours, best = NeighbourSum(), float("inf")
    neighbours.sum()
    for _ in range(ROUNDS):
        ti.sync()
        begin = time.perf_counter()
        for _ in range(SUMS):
            neighbours.sum()
        ti.sync()
        best = min(best, time.perf_counter() - begin)
    return PARTICLES * NEIGHBOURS * SUMS / best
