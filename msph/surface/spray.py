"""Spray: images show particles that came loose from the water as clusters of droplets.

A lone particle is as large as a fist, since the simulation resolves no less. In images a particle i
is shown as droplets to the share s_i (-) of its volume, and as part of the mesh for the rest.
With t = (c_sheet - c)/(c_sheet - c_isolated) from its coverage c (thin_water.py), 0 in a sheet, and
t = 1 for a drop, s_i follows smoothstep(LOOSE, t) at most by dt/FADE in a frame. Droplet k lies at

    x_i + R d Q(v) q_k,   R = COMPACT + (WIDE - COMPACT) s_i (1 - exp(-age/SPREADING)),

with d the spacing, q_k a fixed place in the unit ball, and Q a stretch along the velocity; its
radius is d (3 s_i f_k/(4 pi))^(1/3), where the fixed shares f_k of the volume sum to 1. Positions,
and the velocity that stretches, change continuously, so that nothing pops. Spray does not act on
the water, and exported meshes have no spray.
"""

import numpy as np
import taichi as ti

from msph.device_table import DeviceTable, f32, i32
from msph.fluid.particles.layers import SPHERE_RADIUS
from msph.launches import data_oriented, kernel
from msph.surface.room import SurfaceRoom

vec3 = ti.math.vec3

# Droplets of a particle, and the standard deviation of the logarithm of their radii: the radii of
# the largest and the smallest differ by a factor of about 8.
DROPLETS, SCATTER = 48, 0.45
# Number of different patterns of places; particles with equal remainders of their ids share one.
PATTERNS = 32
# Looseness t (-) between which a particle becomes spray: a thread has 0.65, a pair 0.85.
LOOSE = (0.5, 0.85)
# Time [s] in which a particle becomes spray or rejoins the water, and in which spray spreads and
# its stretch follows its velocity.
FADE, SPREADING, TURNING = 0.1, 0.2, 0.1
# Radius of a cluster when it comes loose and later, in spacings.
COMPACT, WIDE = 0.6, 1.6
# Time [s] of flight by which a cluster is longer along its velocity, and largest stretch (-).
SHEAR, LONGEST = 0.04, 2.5
# Rows of the table of states, by the remainder of ids: ids count up, and two loose particles with
# the same remainder, which would disturb each other, are rare.
SLOTS = 1 << 18
# Least speed [m/s] that has a direction.
LEAST = 1e-6


def pattern(seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Returns places in the unit ball (PATTERNS, DROPLETS, 3) with the mean 0, and the share of the
    volume of each droplet (DROPLETS,), the largest first."""
    rng = np.random.default_rng(seed)
    way = rng.normal(size=(PATTERNS, DROPLETS, 3))
    way /= np.linalg.norm(way, axis=2, keepdims=True)
    place = way * np.cbrt(rng.uniform(size=(PATTERNS, DROPLETS, 1)))
    radius = np.exp(SCATTER * np.sort(rng.normal(size=DROPLETS))[::-1])
    share = radius**3 / (radius**3).sum()
    place -= np.einsum("pki,k->pi", place, share)[:, None]
    return place / np.maximum(np.linalg.norm(place, axis=2).max(), 1.0), share


@data_oriented
class Spray:
    """States and droplets of loose particles. state (SLOTS,), by the remainder of ids: id, number
    of the last frame in which the particle was near the surface, share s (-), age [s] and v [m/s].

    The first count[None] entries of loose are the indices of the particles with droplets.
    """

    def __init__(self, layers, particles, bounds, room: SurfaceRoom):
        self.layers, self.particles, self.bounds = layers, particles, bounds
        self.state = DeviceTable((SLOTS,), id=i32, frame=i32, share=f32, age=f32, v=vec3)
        self.loose = ti.field(ti.i32, shape=room.particles)
        self.count = ti.field(ti.i32, shape=())
        self.pattern = DeviceTable((PATTERNS, DROPLETS), place=vec3, share=f32)
        place, share = pattern()
        self.pattern.fill(place=place, share=np.tile(share, (PATTERNS, 1))[..., None])
        # Frames since the reset, counted from 1, and time since the last frame [s].
        self.frame, self.elapsed = 0, 0.0

    def reset(self) -> None:
        """Forgets all states."""
        self.frame, self.elapsed = 0, 0.0
        self.state.frame.fill(0)

    def next_frame(self) -> tuple[int, float]:
        """Returns the number of the next frame, and the time since the last one [s]."""
        elapsed, self.elapsed = self.elapsed, 0.0
        self.frame += 1
        return self.frame, elapsed

    def droplets(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Returns places (n, 3) [m], radii (n,) [m] and velocities (n, 3) [m/s] of all droplets at
        the last extract()."""
        n = self.count[None] * DROPLETS
        x, radius, v = (np.zeros(shape, np.float32) for shape in ((n, 3), n, (n, 3)))
        if n:
            self._read(x, radius, v)
        return x, radius, v

    @kernel
    def _read(
        self,
        x: ti.types.ndarray(dtype=ti.f32, ndim=2),
        radius: ti.types.ndarray(dtype=ti.f32, ndim=1),
        v: ti.types.ndarray(dtype=ti.f32, ndim=2),
    ):
        for q in range(radius.shape[0]):
            place, r, speed = self.droplet(self.loose[q // DROPLETS], q % DROPLETS)
            radius[q] = r
            for k in ti.static(range(3)):
                x[q, k], v[q, k] = place[k], speed[k]

    @ti.func
    def follow(self, i, looseness, frame, dt):
        """Returns the share s (-) of particle i in a frame dt [s] after the last one, and lists the
        particle if it has droplets."""
        at, v = self.particles.id[i] % SLOTS, self.particles.v[i]
        t = ti.math.clamp((looseness - LOOSE[0]) / (LOOSE[1] - LOOSE[0]), 0.0, 1.0)
        share, age = t * t * (3.0 - 2.0 * t), 0.0
        # Display.draw_as_with_bodies() repeats the number of a frame.
        known = self.state.id[at] == self.particles.id[i] and self.state.frame[at] >= frame - 1
        if known and frame > 1:
            before, most = self.state.share[at], dt / FADE
            share = ti.math.clamp(share, before - most, before + most)
            turned = ti.exp(-dt / TURNING)
            v = ti.math.mix(v, self.state.v[at], turned)
            age = self.state.age[at] + dt
        if share == 0.0:
            age = 0.0
        else:
            self.loose[ti.atomic_add(self.count[None], 1)] = i
        self.state.id[at], self.state.frame[at] = self.particles.id[i], frame
        self.state.share[at], self.state.age[at], self.state.v[at] = share, age, v
        return share

    @ti.func
    def droplet(self, i, k):
        """Returns the place [m], the radius [m] and the velocity [m/s] of droplet k of particle
        i."""
        at, d = self.particles.id[i] % SLOTS, self.layers.spacing[self.particles.layer[i]]
        share, age, v = self.state.share[at], self.state.age[at], self.state.v[at]
        wide = ti.math.mix(COMPACT, WIDE, share * (1.0 - ti.exp(-age / SPREADING)))
        x, size = self.particles.x[i], share ** (1.0 / 3.0) * SPHERE_RADIUS * d
        out, radius = self.cluster(self.particles.id[i], k, v, wide * d, size)
        high = self.bounds.size[None] - radius
        # Spray above an open top is not held down.
        high.y = ti.max(high.y, x.y + out.y)
        return ti.math.clamp(x + out, radius, high), radius, v

    @ti.func
    def cluster(self, number, k, v, wide, size):
        """Returns the place [m] relative to the centre, and the radius [m], of droplet k in a
        cluster of the given number with a velocity v [m/s], a radius `wide` [m] before its stretch,
        and the volume of a ball of radius `size` [m]."""
        q, speed = wide * self.pattern.place[number % PATTERNS, k], v.norm()
        stretch = ti.min(SHEAR * speed / wide, LONGEST)
        q += stretch * q.dot(v) / ti.max(speed * speed, LEAST) * v
        return q, size * self.pattern.share[0, k] ** (1.0 / 3.0)
