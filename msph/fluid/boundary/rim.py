"""Water that leaves the box, over the rim of an open box or through an outflow.

After each step, particles beyond a wall, which they can only pass above the rim or through an
opening, are removed, except from pipes and from jets near holes; and so are particles above the
ceiling or where an outflow in the box removes them. Their mass, momentum and energy are recorded,
and outside the box they fall on as drops that are only drawn.
"""

import numpy as np
import taichi as ti

from msph.device_table import DeviceTable, f32
from msph.errors import MsphError
from msph.fluid.part import Part, Parts
from msph.fluid.particles.layers import MAX_LAYERS, SPHERE_RADIUS
from msph.launches import data_oriented, kernel

vec3 = ti.math.vec3

# Largest number of drops; new ones replace the oldest.
MOST_DROPS = 2048
# Time [s] after which a drop vanishes, if it has not reached the ground.
LIFE = 3.0


class AllSpiltError(MsphError):
    """No water is left in an open box."""


def drop_table() -> DeviceTable:
    """Returns a table of drops: x [m], v [m/s], radius [m] and remaining life [s]."""
    return DeviceTable((MOST_DROPS,), x=vec3, v=vec3, radius=f32, life=f32)


@data_oriented
class Rim(Part):
    """Removes particles that leave the box. mass [kg]: spilt since the start; outflow [kg]: left
    through outflows. drops (MOST_DROPS,): x [m], v [m/s], radius [m] and the remaining life [s]
    (0: no drop) of the drops that the particles become."""

    def __init__(self, parts: Parts):
        super().__init__(parts)
        self.drops = drop_table()
        # Numbers of particles that left since the reset: spilt, and through outflows.
        self.left = ti.field(ti.i32, shape=(2, MAX_LAYERS))
        self.added = ti.field(ti.i32, shape=())  # drops since the reset
        self.open, self.mass, self.outflow = False, 0.0, 0.0
        self._counted = np.zeros((2, MAX_LAYERS), int)

    def load(self, is_open: bool) -> None:
        """Sets whether the top is open or there are openings, and compiles the kernels by launching
        them without particles: also a body that is added to a closed box takes water's place."""
        self.open = is_open

    def compile(self) -> None:
        """Compiles the kernels, by launching them without effect."""
        self._mark(0)
        self._take(np.zeros(0, np.int32))
        self._hand_over(0, vec3(0.0))
        self._fall(0.0, vec3(0.0))
        self.removal.compile()

    def reset(self, mass: float = 0.0) -> None:
        """Removes all drops. mass [kg]: spilt before."""
        self.mass, self.outflow, self._counted = mass, 0.0, np.zeros((2, MAX_LAYERS), int)
        # Also in a box that is closed again: an outflow of the user may have been open.
        self.drops.fill()
        self.left.fill(0)
        self.added[None] = 0

    def spill(self, gravity: tuple[float, float, float], taken: np.ndarray) -> bool:
        """Removes the particles outside an open box, and those of the indices `taken` (k,), under
        gravity [m/s^2]; returns True if there are any. Grid and neighbour list become invalid.
        Raises AllSpiltError if no particle is left."""
        n = self.particles.count
        if not (self.open or len(taken)) or (self._mark(n) == 0 and len(taken) == 0):
            return False
        if len(taken):
            self._take(taken)
        self._hand_over(n, vec3(gravity))
        self.removal.run(n)
        counts = self.left.to_numpy()
        masses = np.array([spec.mass for spec in self.layers.specs])
        spilt, drained = (counts - self._counted)[:, : len(masses)] @ masses
        self.mass, self.outflow = self.mass + float(spilt), self.outflow + float(drained)
        self._counted = counts
        if self.particles.count == 0:
            raise AllSpiltError("all water has left the box")
        return True

    @property
    def has_drops(self) -> bool:
        """False as long as no water has left the box."""
        return self.mass + self.outflow > 0.0

    def fall(self, dt: float, gravity: tuple[float, float, float]) -> None:
        """Moves the drops by dt [s] under gravity [m/s^2]."""
        if self.open and self.has_drops:
            self._fall(dt, vec3(gravity))

    @kernel
    def read_drops(self, found: ti.types.ndarray(dtype=ti.f32, ndim=2)):
        """Reads x, v, radius and life of all drops into the columns of `found` (MOST_DROPS, 8)."""
        for k in range(MOST_DROPS):
            x, v = self.drops.x[k], self.drops.v[k]
            for axis in ti.static(range(3)):
                found[k, axis], found[k, 3 + axis] = x[axis], v[axis]
            found[k, 6], found[k, 7] = self.drops.radius[k], self.drops.life[k]

    @kernel
    def _mark(self, n: ti.i32) -> ti.i32:
        """Sets alive to 0 for the particles outside; returns their number."""
        found = 0
        ti.loop_config(serialize=self.traits.light)
        for i in range(n):
            x = self.particles.x[i]
            out = self.apertures.beyond(x) != 0 and not self.apertures.holds(x)
            out = out or self.apertures.removes(x) or x.y > self.constants.ceiling[None]
            self.particles.alive[i] = ti.select(out, 0, 1)
            found += ti.cast(out, ti.i32)
        return found

    @kernel
    def _take(self, taken: ti.types.ndarray(dtype=ti.i32, ndim=1)):
        for k in range(taken.shape[0]):
            self.particles.alive[taken[k]] = 0

    @kernel
    def _hand_over(self, n: ti.i32, gravity: vec3):
        """Records the particles outside, m v and m (v^2/2 - g.x) of each, and makes drops."""
        p = self.particles
        for i in range(n):
            if p.alive[i] == 0:
                layer, x, v = p.layer[i], p.x[i], p.v[i]
                m = self.layers.mass[layer]
                energy = m * (0.5 * v.norm_sqr() - gravity.dot(x))
                if self.apertures.leaves_by_opening(x):
                    self.left[1, layer] += 1
                    self.impulses.outflow_momentum.add(i, m * v)
                    self.impulses.outflow_energy.add(i, energy)
                else:
                    self.left[0, layer] += 1
                    self.impulses.spilt_momentum.add(i, m * v)
                    self.impulses.spilt_energy.add(i, energy)
                if self.apertures.beyond(x) != 0 or x.y > self.constants.ceiling[None]:
                    at = ti.atomic_add(self.added[None], 1) % MOST_DROPS
                    self.drops.x[at], self.drops.v[at], self.drops.life[at] = x, v, LIFE
                    self.drops.radius[at] = SPHERE_RADIUS * self.layers.spacing[layer]

    @kernel
    def _fall(self, dt: ti.f32, gravity: vec3):
        """Moves the drops ballistically, down to the level of the box's lowest corner."""
        for k in range(MOST_DROPS):
            if self.drops.life[k] > 0.0:
                v, size = self.drops.v[k] + dt * gravity, self.constants.size[None]
                x = self.drops.x[k] + dt * v
                down = x - 0.5 * size
                landed = down.dot(gravity) > 0.5 * abs(gravity).dot(size)
                self.drops.x[k], self.drops.v[k] = x, v
                life = ti.max(self.drops.life[k] - dt, 0.0)
                self.drops.life[k] = ti.select(landed, 0.0, life)
