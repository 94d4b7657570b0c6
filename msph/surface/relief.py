"""Relief: waves smaller than the particles on water in the air, which bend the normals of images.

The simulation resolves nothing smaller than its particles, so a lump of a few particles would be
smooth like glass. Each particle j carries a wave that moves with the particle. With e = x - x_j,
t_j = e.k_j/(WAVELENGTH d_j) + PHASE (id_j mod PATTERNS), and weights
w_j = (1 - e^2/(REACH d_j)^2)^2 within reach, the relief at x has

    height  sum_j w_j s(t_j) / sqrt(LEAST_WEIGHT2 + sum_j w_j^2),  s(t) = sin 2 pi t + sin(4 pi t)/2

and the slope STEEP times the same sum with k_j (cos 2 pi t + cos 4 pi t): noise of sparse waves
(Lagae et al. 2009) whose places are the particles. k_j is a fixed vector in the unit ball,
shortened along the velocity, so that waves are streaks. Sine and cosine are polynomials, since the
sums are computed per pixel, but only for water in the air.
"""

import taichi as ti

from msph.launches import data_oriented
from msph.surface.spray import DROPLETS, PATTERNS, Spray

vec3, vec4 = ti.math.vec3, ti.math.vec4

# Reach of a wave, and wavelength for |k_j| = 1 without the harmonic, in spacings.
REACH, WAVELENGTH = 1.3, 0.5
# Slope of one wave (-), share of k_j along a velocity far above SLOW [m/s] that is removed, and
# difference of phase between ids (the golden ratio: no two near ids have near phases).
STEEP, STREAKS, SLOW, PHASE = 0.6, 0.7, 0.3, 0.618
# Sum of squared weights (-) below which the relief fades, so that it is continuous.
LEAST_WEIGHT2 = 0.05


@ti.dataclass
class Waves:
    """Sums over the particles of a layer near x [m]: slope, height and squared weights (-) of their
    waves. per_reach2: 1/reach^2 [1/m^2]; number: waves per length for |k_j| = 1 [1/m]."""

    x: vec3
    per_reach2: ti.f32
    number: ti.f32
    slope: vec3
    height: ti.f32
    weight2: ti.f32


@data_oriented
class Relief:
    """Relief of the water of a surface; particles and grid must be those of the last mesh."""

    def __init__(self, layers, grid, particles, numbers, spray: Spray):
        self.layers, self.grid, self.particles, self.numbers = layers, grid, particles, numbers
        self.vectors = spray.pattern

    @ti.func
    def at(self, x):
        """Returns slope (3 components) and height (-) of the relief at x [m]."""
        waves, weight2 = vec4(0.0), LEAST_WEIGHT2
        for layer in range(self.numbers.layers[None]):
            d = self.layers.spacing[layer]
            found = Waves(x=x, per_reach2=1.0 / (REACH * d) ** 2, number=1.0 / (WAVELENGTH * d))
            self.grid.for_each_row(x, layer, REACH * d, self.add_row, found)
            waves += vec4(STEEP * found.slope, found.height)
            weight2 += found.weight2
        return waves / ti.sqrt(weight2)

    @ti.func
    def add_row(self, begin, end, found: ti.template()):
        for j in range(begin, end):
            e = found.x - self.particles.x[j]
            u = 1.0 - e.norm_sqr() * found.per_reach2
            if u > 0.0:
                number, v, w = self.particles.id[j], self.particles.v[j], u * u
                k = self.vectors.place[number % PATTERNS, number // PATTERNS % DROPLETS]
                k -= STREAKS * k.dot(v) / (v.norm_sqr() + SLOW * SLOW) * v
                # Large ids would leave no digits for the position.
                t = found.number * k.dot(e) + PHASE * (number % PATTERNS)
                t -= ti.round(t)
                c = 1.0 - 4.0 * abs(t)
                sine, cosine = 8.0 * t * (1.0 - 2.0 * abs(t)), c * (1.5 - 0.5 * c * c)
                found.height += w * sine * (1.0 + cosine)
                found.slope += w * (cosine + 1.0 - 2.0 * sine * sine) * k
                found.weight2 += w * w
