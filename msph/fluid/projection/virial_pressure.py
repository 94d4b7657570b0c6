"""Pressure and stress in the water, from the multipliers that a velocity solve found.

A multiplier p_i is no pressure of its own: i and j press on each other with
V_i V_j (p_i + p_j) grad W_ij, and weight is borne by all pairs across a plane. So the pressure at a
particle is a third of the trace of its virial stress (Irving and Kirkwood 1950),

    S_i = -sum V_j share_ij (p_i + p_j) r_ij (x) grad W_ij,

of which the coarser end of a pair has the larger share (layers.stress_share). At surfaces, where
directions are missing, it is the mean of (p_i + p_j)/2 by -V_j r_ij.grad W_ij instead
(docs/method.md, "Pressure").

A body is no partner: it pushes with the multiplier of the particle that it meets, which for that is
larger than the pressure, up to twice. What pushes is the gradient of the kernel's mean of
multipliers, where the body counts as 0: so beside bodies this mean is the pressure.
"""

import taichi as ti

from msph.fluid.particles.layers import Layers
from msph.fluid.particles.neighbour_list import NeighbourList
from msph.fluid.particles.particles import Particles
from msph.fluid.projection.density import Density
from msph.taichi_internals import data_oriented, longest_float

# Sum of the weights (-) from which on there is a mean; 3 in bulk.
LEAST_WEIGHT = 1e-6
# Thirds of that sum between which the mean gives way to the trace: flat surfaces have .82 to .87,
# bulk .96 to 1.04 between layers and .99 to 1.01 else.
SURFACE_WEIGHT, BULK_WEIGHT = 0.85, 0.95
# Speed over sqrt(a d) (-) from which on the acceleration a by images' excess pressure bears rising
# particles among unlike ones no more: in sloshing water .005 in the median; coarse ones bounced at
# .08. And the share by which spacings differ among particles of another layer, twice the mass.
FOLLOWED, UNLIKE = 0.05, 0.1
# Least acceleration [m/s^2] that has a direction.
LEAST_ACCELERATION = 1e-6


@data_oriented
class VirialPressure:
    """Reads particles' `pressure_multiplier` [Pa], and the densities of the last refresh().

    Pressed is what presses on a particle: accelerations [m/s^2] by other particles and by walls,
    the virial pressure [Pa], and if `stressed` S by its diagonal and its yz, xz, xy components
    [Pa]. Pushes are summed in double precision where the device has it: at rest their sums round
    off in every step in the same way, and the water's momentum drifted.
    """

    def __init__(
        self,
        layers: Layers,
        particles: Particles,
        neighbours: NeighbourList,
        density: Density,
    ):
        self.layers, self.particles, self.neighbours = layers, particles, neighbours
        self.images, self.density, self.constants = neighbours.images, density, density.constants
        self.pair_gradient = density.pair_gradient
        self.long_vector = ti.types.vector(3, longest_float())
        self.Pressed = ti.types.struct(
            inner=self.long_vector,
            wall=self.long_vector,
            virial=ti.f32,
            normal=ti.math.vec3,
            shear=ti.math.vec3,
        )

    @ti.func
    def pressed(self, i, gravity, stressed: ti.template()):
        """Particle i under the multipliers, bodies left out: Pressed, in one pass. A lone
        particle's pressure is its own multiplier."""
        layer, x = self.particles.layer[i], self.particles.x[i]
        own, found = self.particles.pressure_multiplier[i], self.Pressed()
        trace, others, weights = 0.0, 0.0, 0.0
        for mirrored in ti.static((False, True)):
            pushes = self.long_vector(0.0)
            begin, end = self.neighbours.span(i, mirrored)
            for s in range(begin, end):
                j, mirror, wall = self.neighbours.read(s, mirrored)
                gradient = self.pair_gradient[s]
                r_ij = self.images.offset(x, self.particles.x[j], mirror, wall)
                weight = -r_ij.dot(gradient)
                other = self.particles.pressure_multiplier[j]
                pushes -= (own + other) * gradient
                if ti.static(mirrored):
                    other += self.image_excess(x - r_ij, j, gravity)
                others += weight * other
                weights += weight
                share = self.layers.stress_share[layer, self.particles.layer[j]]
                trace += share * weight * (own + other)
                if ti.static(stressed):
                    push = -share * (own + other) * gradient
                    found.normal += r_ij * push
                    found.shear += ti.Vector([r_ij.y * push.z, r_ij.x * push.z, r_ij.x * push.y])
            if ti.static(mirrored):
                found.wall = pushes / self.constants.rest_density[None]
            else:
                found.inner = pushes / self.constants.rest_density[None]
        mean = ti.select(weights > LEAST_WEIGHT, others / ti.max(weights, LEAST_WEIGHT), own)
        bulk = (weights / 3.0 - SURFACE_WEIGHT) / (BULK_WEIGHT - SURFACE_WEIGHT)
        bulk = ti.math.clamp(bulk, 0.0, 1.0)
        found.virial = ti.math.mix(0.5 * (own + mean), trace / 3.0, bulk)
        return found

    @ti.func
    def beside_body(self, i, gravity):
        """Pressure [Pa] at particle i, which a body's kernel integral reaches: the mean of its own
        and its neighbours' multipliers, weighed as in c_i, where bodies have the weight lambda_i
        and the pressure 0.

        With p the sum of V_j q_j W_ij over all, u_i = -grad p - q_i grad c_i by definition, and
        grad c is 0 in the mean where c = 1.
        """
        layer, x = self.particles.layer[i], self.particles.x[i]
        total = self.layers.own[layer] * self.particles.pressure_multiplier[i]
        for mirrored in ti.static((False, True)):
            begin, end = self.neighbours.span(i, mirrored)
            for s in range(begin, end):
                j, mirror, wall = self.neighbours.read(s, mirrored)
                r_ij = self.images.offset(x, self.particles.x[j], mirror, wall)
                q = self.particles.pressure_multiplier[j]
                if ti.static(mirrored):
                    q += self.image_excess(x - r_ij, j, gravity)
                total += q * self.density.weight(layer, self.particles.layer[j], r_ij.norm())
        return total / (1.0 + self.density.excess(i))

    @ti.func
    def image_acceleration(self, i, gravity):
        """Acceleration [m/s^2] by the excess pressure of the mirror images round particle i.

        Without it the lowest sheet bears half a sheet's weight too much. Like particles give back
        what they take from it, unlike ones, which change places, do not: so it fades where these
        follow it, and feeds no motion.
        """
        layer, x = self.particles.layer[i], self.particles.x[i]
        total = ti.Vector([0.0, 0.0, 0.0])
        for s in range(self.neighbours.mirrors[i], self.neighbours.end[i]):
            j, mirror, wall = self.images.read(self.neighbours.index[s])
            seen_at = x - self.images.offset(x, self.particles.x[j], mirror, wall)
            total -= self.image_excess(seen_at, j, gravity) * self.pair_gradient[s]
        acceleration = total / self.constants.rest_density[None]
        size = ti.max(acceleration.norm(), LEAST_ACCELERATION)
        d, along = self.layers.spacing[layer], self.particles.v[i].dot(acceleration) / size
        unlike = ti.min(ti.abs(self.particles.pair_spacing[i] / d - 1.0) / UNLIKE, 1.0)
        followed = unlike * along / (FOLLOWED * ti.sqrt(size * d))
        return acceleration * ti.math.clamp(1.0 - followed, 0.0, 1.0)

    @ti.func
    def image_excess(self, seen_at, j, gravity):
        """Pressure [Pa] of the image of j, seen at a point [m], over that of j itself.

        No flow crosses a wall, so there dp/dn = rho g.n: behind a floor the pressure goes on
        rising. At most the particle's own, so that water that only passes by is not lifted.
        """
        own = self.particles.pressure_multiplier[j]
        weight = self.constants.rest_density[None] * gravity.dot(seen_at - self.particles.x[j])
        return ti.math.clamp(weight, -own, own)
