"""Radiance of sky and open ground by direction; world frame, linear RGB.

The sky (gradient, clouds, glow around the sun) is painted once into a dome: a square map of the
upper hemisphere by stereographic projection, (x, z) / (1 + y).
"""

import taichi as ti

from msph.launches import data_oriented, kernel
from msph.picture.pixels import bilinear

vec3 = ti.math.vec3

CELLS = 256  # dome resolution
ZENITH = vec3(0.085, 0.235, 0.56)
HORIZON = vec3(0.66, 0.80, 0.94)
CLOUD = vec3(0.98, 0.99, 1.02)
SUN = vec3(1.0, 0.90, 0.72)
GROUND = vec3(0.60, 0.575, 0.53)
DUSK = 0.42  # exponent of the gradient: smaller is a paler, narrower horizon
CLOUD_SCALE, CLOUD_DRIFT = 0.85, 3.7  # features per unit of the cloud plane; its offset
CLOUD_CURVE = 0.18  # added to the sine of elevation: keeps distant clouds visible
CLEAR, OVERCAST = 0.46, 0.80  # noise without clouds, and with full clouds
CLOUD_OPACITY, CLOUD_RISE = 0.75, 0.25  # sine of elevation over which clouds fade in
OCTAVES, FINER = 5, 2.03  # of the noise; ratio of their frequencies
WIDE_GLOW, WIDE_POWER, CORE_GLOW, CORE_POWER = 0.22, 12, 0.5, 160  # around the sun
HAZE = 0.16  # sine of the angle below the horizon within which ground fades into haze
# Irradiance over pi of the pool and its contents.
SUN_LIGHT, SKY_LIGHT = vec3(0.92, 0.85, 0.71), vec3(0.50, 0.55, 0.60)


@ti.func
def noise(p):
    """Returns smooth value noise in 0..1 on the plane."""
    c = ti.floor(p)
    f = p - c
    u = f * f * (3.0 - 2.0 * f)
    a = ti.math.mix(lattice(c), lattice(c + ti.math.vec2(1, 0)), u.x)
    b = ti.math.mix(lattice(c + ti.math.vec2(0, 1)), lattice(c + ti.math.vec2(1, 1)), u.x)
    return ti.math.mix(a, b, u.y)


@ti.func
def lattice(c):
    """Returns a fixed pseudo-random number in 0..1 for each integer point of the plane."""
    k = ti.cast(c, ti.i32) + 4096
    h = ti.cast(k.x, ti.u32) * ti.u32(374761393) + ti.cast(k.y, ti.u32) * ti.u32(668265263)
    h = (h ^ (h >> 13)) * ti.u32(1274126177)
    return ti.cast((h ^ (h >> 16)) & ti.u32(0xFFFF), ti.f32) / 65535.0


@data_oriented
class Sky:
    def __init__(self):
        self.dome = ti.Vector.field(3, ti.f32, (CELLS, CELLS))

    @kernel
    def paint(self, sun: vec3):
        """Paints the dome. sun: unit vector to the sun, world frame."""
        for i, j in self.dome:
            q = (ti.math.vec2(i, j) + 0.5) * (2.0 / CELLS) - 1.0
            s = ti.min(q.norm_sqr(), 1.0)
            d = vec3(2.0 * q.x, 1.0 - s, 2.0 * q.y) / (1.0 + s)
            colour = ti.math.mix(HORIZON, ZENITH, d.y**DUSK)
            p = d.xz / (d.y + CLOUD_CURVE) * CLOUD_SCALE + CLOUD_DRIFT
            cloud, weight = 0.0, 0.5
            for _ in range(OCTAVES):
                cloud += weight * noise(p)
                weight *= 0.5
                p = FINER * p + CLOUD_DRIFT
            cover = ti.math.smoothstep(CLEAR, OVERCAST, cloud)
            cover *= CLOUD_OPACITY * ti.math.smoothstep(0.0, CLOUD_RISE, d.y)
            near_sun = ti.max(d.dot(sun), 0.0)
            glow = WIDE_GLOW * near_sun**WIDE_POWER + CORE_GLOW * near_sun**CORE_POWER
            self.dome[i, j] = ti.math.mix(colour, CLOUD, cover) + SUN * glow

    @ti.func
    def radiance(self, d):
        """Returns the radiance from the world direction d (unit): sky, or hazy ground below."""
        q = (ti.math.vec2(d.x, d.z) / (1.0 + abs(d.y)) + 1.0) * (0.5 * CELLS) - 0.5
        q = ti.math.clamp(q, 0.0, CELLS - 1.001)
        colour = bilinear(self.dome, q)
        if d.y < 0.0:
            colour = haze(GROUND, d.y)
        return colour


@ti.func
def haze(colour, sine):
    """Returns the colour of distant ground at `sine` below the horizon (negative)."""
    s = ti.min(-sine / HAZE, 1.0)
    return ti.math.mix(HORIZON, colour, s * (2.0 - s))
