"""The tests of a GPU's self-test: each returns True if kernels agree with NumPy.

The primitives are operations that have failed on some GPU: scans, atomics, maxima of negative
numbers, and counters in serial loops. A small pool then tests the fluid as a whole.
"""

from collections.abc import Callable
from functools import cache

import numpy as np
import taichi as ti

from msph.fluid.external_forces import ExternalForces
from msph.fluid.particles.layers import LayerSpec
from msph.fluid.particles.prefix_sum import PrefixSum
from msph.fluid.plan import Plan
from msph.fluid.projection.density import SMOOTHINGS, YIELDS
from msph.fluid.projection.parameters import ProjectionParameters
from msph.fluid.projection.solver import Projection
from msph.fluid.simulation import Simulation
from msph.launches import data_oriented, kernel
from msph.measure.kernel_density import kernel_sums

# Length of the array in each test of a primitive, and of a row in the test of serial loops.
COUNT, ROW = 10_000, 20
# Number of places with a shared minimum; a thread writes to fewer than MOST_OFFERS of them.
SHARED, MOST_OFFERS = 100, 19
# Spacing of the particles of the pool [m], its box and its depth [spacings].
SPACING, BOX, DEPTH = 0.05, (8, 10, 8), 5
# Simulated time [s]; limits (-) of the difference from NumPy's densities, of the density error, of
# the kinetic energy over M g H, and of the momentum over the momentum of a fall without a floor.
TIME, SAME, DENSITY_LIMIT, MOTION_LIMIT, MOMENTUM_LIMIT = 1.0 / 30.0, 1e-4, 0.01, 2e-3, 0.02
GRAVITY = 9.81


@data_oriented
class Primitives:
    """Kernels over `given` (COUNT,) i32, negative and positive numbers."""

    def __init__(self):
        self.given = ti.field(ti.i32, COUNT)
        self.made = ti.field(ti.i32, COUNT + 1)
        self.count = ti.field(ti.i32, ())
        self.numbers = np.random.default_rng(0).integers(-9, 10, COUNT).astype(np.int32)
        self.given.from_numpy(self.numbers)

    def prefix_sum(self) -> bool:
        """Tests a prefix sum: the result at i is the sum of the numbers before i."""
        PrefixSum().run(self.given, self.made, COUNT)
        expected = np.concatenate([[0], np.cumsum(self.numbers)])
        return bool((self.made.to_numpy() == expected).all())

    def atomic_append(self) -> bool:
        """Tests that threads append the indices of all positive numbers, each once."""
        self._append(COUNT)
        count = self.count[None]
        found = np.sort(self.made.to_numpy()[:count])
        return np.array_equal(found, np.flatnonzero(self.numbers > 0))

    def maximum(self) -> bool:
        """Tests the maximum of numbers that are all below -1."""
        expected = np.float32(self.numbers.max()) - np.float32(20.5)
        return self._largest(COUNT) == float(expected)

    def serial_counter(self) -> bool:
        """Tests serial loops in which a thread moves positive numbers of a row to its front."""
        self._compact(COUNT // ROW)
        expected = self.made.to_numpy()
        for row, numbers in enumerate(self.numbers.reshape(-1, ROW)):
            kept = numbers[numbers > 0]
            expected[row * ROW : row * ROW + len(kept)] = kept
            expected[row * ROW + len(kept) : (row + 1) * ROW] = -len(kept)
        return np.array_equal(self.made.to_numpy(), expected)

    def atomic_in_loop(self) -> bool:
        """Tests atomic minima in a loop: each place keeps the least index that is offered."""
        self._offer(COUNT)
        expected = np.full(SHARED, COUNT)
        for k in range(MOST_OFFERS):
            i = np.flatnonzero(self.numbers + MOST_OFFERS // 2 > k)
            np.minimum.at(expected, (i + k * k) % SHARED, i)
        return np.array_equal(self.made.to_numpy()[:SHARED], expected)

    @kernel
    def _offer(self, n: ti.i32):
        for place in range(SHARED):
            self.made[place] = n
        for i in range(n):
            for k in range(self.given[i] + MOST_OFFERS // 2):
                ti.atomic_min(self.made[(i + k * k) % SHARED], i)

    @kernel
    def _append(self, n: ti.i32):
        self.count[None] = 0
        for i in range(n):
            if self.given[i] > 0:
                self.made[ti.atomic_add(self.count[None], 1)] = i

    @kernel
    def _largest(self, n: ti.i32) -> ti.f32:
        most = -1e9
        for i in range(n):
            ti.atomic_max(most, ti.cast(self.given[i], ti.f32) - 20.5)
        return most

    @kernel
    def _compact(self, rows: ti.i32):
        for row in range(rows):
            place, count = row * ROW, 0
            for i in range(row * ROW, (row + 1) * ROW):
                if self.given[i] > 0:
                    self.made[place] = self.given[i]
                    place += 1
                    count += 1
            while place < (row + 1) * ROW:
                self.made[place] = -count
                place += 1


class Pool:
    """A small pool at rest, by the project's own simulation."""

    def __init__(self):
        self.size = tuple(SPACING * n for n in BOX)
        shape = (BOX[0], DEPTH, BOX[2])
        x = SPACING * (np.indices(shape).reshape(3, -1).T + 0.5)
        x += np.random.default_rng(1).uniform(-0.05, 0.05, x.shape) * SPACING
        self.spec = LayerSpec(1000.0 * SPACING**3, 1000.0, Projection.SMOOTHING)
        start = {"x": x.astype(np.float32), "layer": np.zeros(len(x), np.int32)}
        plan = Plan(self.size, [self.spec], start, ProjectionParameters())
        self.simulation = Simulation(plan)

    def density(self) -> bool:
        """Tests relative densities against sums on the host with the yield correction."""
        sim = self.simulation
        sim.measure_density()
        p = sim.particles
        found = p.numpy("density") / self.spec.density - p.numpy("density_correction")
        sums = kernel_sums(p.numpy("x").astype(float), np.full(p.count, SPACING), self.size)
        expected = 1.0 + (sums - 1.0) / np.interp(Projection.SMOOTHING, SMOOTHINGS, YIELDS)
        return bool(np.abs(found - expected).max() < SAME)

    def pressure(self) -> bool:
        """Tests that after TIME the pool has its particles and density, and is at rest."""
        sim = self.simulation
        count = sim.particles.count
        sim.reset()
        sim.advance(TIME, ExternalForces((0.0, -GRAVITY, 0.0)))
        sim.measure_density()
        p = sim.particles
        v, excess = p.numpy("v").astype(float), p.numpy("density") / self.spec.density - 1.0
        depth = DEPTH * SPACING
        return bool(
            p.count == count
            and np.isfinite(v).all()
            and np.maximum(excess, 0.0).mean() < DENSITY_LIMIT
            and 0.5 * (v**2).sum(axis=1).mean() < MOTION_LIMIT * GRAVITY * depth
            and np.abs(v.mean(axis=0)).max() < MOMENTUM_LIMIT * GRAVITY * TIME
        )


@cache
def _primitives() -> Primitives:
    return Primitives()


@cache
def _pool() -> Pool:
    return Pool()


# Mesa's software driver fails this test: it runs only the first iterations of a loop with an atomic
# operation, so images lack most of the water. The test is last, so that all others run before.
ATOMIC_LOOP = "atomic operation in a loop"
TESTS: dict[str, Callable[[], bool]] = {
    "prefix sum": lambda: _primitives().prefix_sum(),
    "atomic append": lambda: _primitives().atomic_append(),
    "maximum of negative numbers": lambda: _primitives().maximum(),
    "counter in a serial loop": lambda: _primitives().serial_counter(),
    "density": lambda: _pool().density(),
    "pressure": lambda: _pool().pressure(),
    ATOMIC_LOOP: lambda: _primitives().atomic_in_loop(),
}
