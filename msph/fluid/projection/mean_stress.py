"""Mean stress around a particle, and the relief that follows from it (shear_relief.py).

With the virial stress S_j of the particles, the deviator of the mean over a kernel is

    T_i = dev(sum V_j W_ij S_j)/sum V_j W_ij,

W the bell (1 - q^2)^4, i included. Gradients are corrected by the inverse L of the kernel's moment
M_i = -sum r (x) g (Bonet and Lok 1999), sums over all entries.
"""

import taichi as ti

from msph.fluid.particles.images import symmetric
from msph.fluid.small_numbers import MIN_WEIGHT

vec3 = ti.math.vec3

# Ratio (-) of deviator to pressure above which the relief fades out, to none at twice this. It is
# 0.01 in the depth, 0.07 at surfaces, 0.5 in a sheet of one particle, which gains energy with 0.2.
MAX_ANISOTROPY = 0.15
# Relative difference (-) of pair_spacing from spacing above which the relief fades out likewise:
# otherwise coarse particles on fine ones of a 64th of their mass gain 0.25 % of the energy in 1 s.
MAX_SPACING_DIFFERENCE = 0.07
# Smallest pressure [Pa] that a deviator is compared with.
MIN_STRESS = 1e-6
# Determinant of the moment M (-) below which there is no relief; from twice this on it is full. It
# is 1 in the depth and 0.4 in the topmost sheet; with 0.05, steps of five times the limit blow up.
LEAST_DETERMINANT = 0.15

# Sums over the entries of one particle: weights (-), weights times stress [Pa], and the moment M
# (-). Symmetric matrices are a diagonal and the yz, xz and xy components.
MeanStress = ti.types.struct(weight=ti.f32, normal=vec3, shear=vec3, stretch=vec3, turn=vec3)


@ti.func
def add_stress(mean: ti.template(), weight, normal, shear):
    """Adds a particle of this weight (-) and stress [Pa]."""
    mean.weight += weight
    mean.normal += weight * normal
    mean.shear += weight * shear


@ti.func
def add_moment(mean: ti.template(), r, g):
    """Adds an entry with the gradient g [1/m] at -r [m]."""
    mean.stretch -= r * g
    mean.turn -= vec3(r.y * g.z, r.x * g.z, r.x * g.y)


@ti.func
def relief_of(mean, spacing_difference):
    """Returns the rows of share T L [Pa], (9,); the share (-) is 1 except where the mean is not
    isotropic or not known. spacing_difference (-): of pair_spacing from spacing."""
    pressure = mean.normal.sum() / 3.0
    normal, shear = mean.normal - pressure, mean.shear
    size = ti.sqrt(normal.norm_sqr() + 2.0 * shear.norm_sqr())
    share = fade_out(MAX_SPACING_DIFFERENCE, spacing_difference)
    share *= fade_out(MAX_ANISOTROPY, size / ti.max(pressure, MIN_STRESS))
    share /= ti.max(mean.weight, MIN_WEIGHT)
    moment = symmetric(mean.stretch, mean.turn)
    share *= ti.math.clamp(moment.determinant() / LEAST_DETERMINANT - 1.0, 0.0, 1.0)
    found = ti.Vector([0.0] * 9)
    if share > 0.0:
        corrected = share * symmetric(normal, shear) @ moment.inverse()
        for row, column in ti.static(ti.ndrange(3, 3)):
            found[3 * row + column] = corrected[row, column]
    return found


@ti.func
def fade_out(limit, value):
    """Returns 1 for values up to `limit`, falling linearly to 0 at twice the limit."""
    return ti.math.clamp(2.0 - value / limit, 0.0, 1.0)
