"""What lights the pool and all that is in it: linear RGB irradiance over pi."""

import taichi as ti

SUN_LIGHT, SKY_LIGHT = ti.math.vec3(0.92, 0.85, 0.71), ti.math.vec3(0.50, 0.55, 0.60)
