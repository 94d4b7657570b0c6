"""Sums over all particles in one kernel launch, accurate to 1e-6 on every backend."""

import numpy as np
import taichi as ti

from msph.fluid.sums import Sum
from msph.fluid.world import World
from msph.launches import data_oriented, kernel
from msph.taichi_internals import longest_float

# Particles per thread, summed in single precision; the host adds the partial sums in double.
# Rounding grows with the number of terms: 32 terms keep the error below 1e-6, also without f64.
CHUNK = 32

# Names of the sums, and their indices in a partial sum.
_VECTORS = ("moment", "momentum", "angular_momentum")
MOMENT, MOMENTUM, SPIN = range(3)
_SCALARS = (
    *("mass", "momentum_scale", "angular_scale", "kinetic"),
    "not_finite",
)
MASS, SPEED, ARM_SPEED, KINETIC, BROKEN = range(5)
_PEAKS = ("top_speed",)
TOP_SPEED = 0


@data_oriented
class Totals:
    """Totals of all particles: mass [kg], first moment sum m x [kg m], momenta, energy, numbers of
    particles not finite and outside, and the solver's impulse ledger; names and units as in Entry.
    """

    def __init__(self, world: World):
        parts, impulses = world.parts, world.parts.impulses
        self.constants, self.contact = parts.constants, parts.contact
        self.particles, self.layers = parts.particles, parts.layers
        self.impulses = impulses
        sums = {name: each for name, each in vars(impulses).items() if isinstance(each, Sum)}
        self.vectors = {name: each.total for name, each in sums.items() if each.vector}
        self.scalars = {name: each.total for name, each in sums.items() if not each.vector}
        self.given_vectors = tuple(self.vectors.values())
        self.given_scalars = tuple(self.scalars.values())

    def read(self) -> dict:
        """Returns the totals by name, each a float or an array (3,)."""
        self.impulses.gather()
        n = self.particles.count
        rows = -(-n // CHUNK)
        vectors = np.zeros((rows, len(_VECTORS), 3), np.float32)
        scalars = np.zeros((rows, len(_SCALARS)), np.float32)
        peaks = np.zeros((rows, len(_PEAKS)), np.float32)
        longest = np.float64 if longest_float() == ti.f64 else np.float32
        impulses = np.zeros((len(self.vectors), 3), longest)
        works = np.zeros(len(self.scalars), longest)
        self._reduce(n, vectors, scalars, peaks, impulses, works)
        return {
            **dict(zip(_VECTORS, vectors.sum(axis=0, dtype=float), strict=True)),
            **dict(zip(_SCALARS, scalars.sum(axis=0, dtype=float).tolist(), strict=True)),
            **dict(zip(_PEAKS, peaks.max(axis=0).tolist(), strict=True)),
            **dict(zip(self.vectors, impulses.astype(float), strict=True)),
            **dict(zip(self.scalars, works.tolist(), strict=True)),
            "outside": self.contact.leaked(),
        }

    @kernel
    def _reduce(
        self,
        n: ti.i32,
        vectors: ti.types.ndarray(),
        scalars: ti.types.ndarray(),
        peaks: ti.types.ndarray(),
        impulses: ti.types.ndarray(),
        works: ti.types.ndarray(),
    ):
        """Adds one row of partial sums per CHUNK particles to zeroed arrays, and copies the impulse
        ledger."""
        for row in range(scalars.shape[0]):
            for i in range(row * CHUNK, ti.min((row + 1) * CHUNK, n)):
                m = self.layers.mass[self.particles.layer[i]]
                x, v = self.particles.x[i], self.particles.v[i]
                speed, arm = v.norm(), (x - 0.5 * self.constants.size[None]).norm()
                spin = x.cross(v)
                for k in ti.static(range(3)):
                    vectors[row, MOMENT, k] += m * x[k]
                    vectors[row, MOMENTUM, k] += m * v[k]
                    vectors[row, SPIN, k] += m * spin[k]
                scalars[row, MASS] += m
                scalars[row, SPEED] += m * speed
                scalars[row, ARM_SPEED] += m * arm * speed
                scalars[row, KINETIC] += 0.5 * m * speed * speed
                total = x.sum() + v.sum()
                if ti.math.isnan(total) or ti.math.isinf(total):
                    scalars[row, BROKEN] += 1.0
                peaks[row, TOP_SPEED] = ti.max(peaks[row, TOP_SPEED], speed)
        for a in ti.static(range(len(self.given_vectors))):
            for k in ti.static(range(3)):
                impulses[a, k] = self.given_vectors[a][None][k]
        for a in ti.static(range(len(self.given_scalars))):
            works[a] = self.given_scalars[a][None]
