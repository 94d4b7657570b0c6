"""Pressure and stress of particles, computed from the multipliers of the pressure solve.

A multiplier p_i is not the pressure at i: i and j press on each other with
V_i V_j (p_i + p_j) grad W_ij, and all pairs across a plane carry the weight above it. The pressure
of a particle is a third of the trace of its virial stress (Irving and Kirkwood 1950),

    S_i = -sum V_j share_ij (p_i + p_j) r_ij (x) grad W_ij,

where the coarser particle of a pair has the larger share (layers.stress_share). At surfaces, where
directions are missing, the pressure is the mean of (p_i + p_j)/2 weighted by -V_j r_ij.grad W_ij
(docs/method.md, "Pressure").

Mirror images in walls and bodies have the multipliers of their particles. Their pressure is larger
by the hydrostatic pressure between particle and image.
"""

import taichi as ti

from msph.fluid.part import Part, Parts
from msph.fluid.small_numbers import MIN_WEIGHT
from msph.launches import data_oriented
from msph.taichi_internals import longest_float

# Sums of the weights over 3 between which the mean blends into the trace: 0.82 to 0.87 at flat
# surfaces, 0.96 to 1.04 in bulk between layers and 0.99 to 1.01 elsewhere in bulk.
SURFACE_WEIGHT, BULK_WEIGHT = 0.85, 0.95
# The images' excess acceleration a fades out on particles that rise at FADE_SPEED sqrt(|a| d)
# (0.005 is the median in sloshing water; coarse particles bounced at 0.08), in full where
# pair_spacing differs from spacing by UNLIKE_SPACING (-), as among particles of twice the mass.
FADE_SPEED, UNLIKE_SPACING = 0.05, 0.1
# Least acceleration [m/s^2] that has a direction.
MIN_ACCELERATION = 1e-6

# Sums over neighbours and images: of weights (-), and of weights times multiplier [Pa], for the
# mean and for the trace.
Sums = ti.types.struct(weights=ti.f32, others=ti.f32, trace=ti.f32)


@data_oriented
class VirialPressure(Part):
    """Evaluation of `pressure_multiplier` [Pa], with the densities of the last refresh().

    Evaluation holds the accelerations [m/s^2] by other particles (inner) and by walls, the virial
    pressure [Pa] and, if `with_stress`, the stress S [Pa]: its diagonal (normal) and yz, xz, xy
    components (shear). Accelerations are summed in double precision where the device has it: at
    rest single precision rounds off alike in every step, and the momentum drifts.
    """

    pair_gradient: ti.MatrixField

    def __init__(self, parts: Parts):
        super().__init__(parts)
        self.long_vector = ti.types.vector(3, longest_float())
        self.Evaluation = ti.types.struct(
            inner=self.long_vector,
            wall=self.long_vector,
            virial=ti.f32,
            normal=ti.math.vec3,
            shear=ti.math.vec3,
        )

    @ti.func
    def evaluate(self, i, gravity, with_stress: ti.template()):
        """Returns the Evaluation of particle i in one pass. A particle without neighbours, or at
        the surface with its whole air share, has its own multiplier as pressure."""
        layer, x = self.particles.layer[i], self.particles.x[i]
        own, found, sums = self.particles.pressure_multiplier[i], self.Evaluation(), Sums()
        pushes = self.long_vector(0.0)
        for s in range(self.neighbours.start[i], self.neighbours.end[i]):
            j, g = self.neighbours.index[s], self.pair_gradient[s]
            other, r_ij = self.particles.pressure_multiplier[j], x - self.particles.x[j]
            pushes -= (own + other) * g
            share = self.layers.stress_share[layer, self.particles.layer[j]]
            self._add(r_ij, g, other, 0.0, share, own, sums, found, with_stress)
        found.inner = pushes / self.constants.rest_density[None]
        pushes = self.long_vector(0.0)
        for s in range(self.particles.first_image[i], self.particles.image_end[i]):
            j, g, arm = self.images.index[s], self.images.gradient[s], self.images.arm[s]
            other = self.particles.pressure_multiplier[j]
            pushes -= (own + other) * g
            share = self.layers.stress_share[layer, self.particles.layer[j]]
            excess = self.image_excess(i, s, gravity)
            self._add(arm, g, other, excess, share, own, sums, found, with_stress)
        found.wall = pushes / self.constants.rest_density[None]
        weights = sums.weights
        mean = ti.select(weights > MIN_WEIGHT, sums.others / ti.max(weights, MIN_WEIGHT), own)
        bulk = (weights / 3.0 - SURFACE_WEIGHT) / (BULK_WEIGHT - SURFACE_WEIGHT)
        bulk = ti.math.clamp(bulk, 0.0, 1.0)
        # Below air, the mean with neighbours is the pressure a quarter of a spacing deeper.
        air = self.particles.air_share[i] / self.layers.surface_share[layer]
        at_surface = ti.math.mix(0.5 * (own + mean), own, air)
        found.virial = ti.math.mix(at_surface, sums.trace / 3.0, bulk)
        return found

    @ti.func
    def _add(
        self,
        r,
        gradient,
        other,
        excess,
        share,
        own,
        sums: ti.template(),
        found: ti.template(),
        with_stress: ti.template(),
    ):
        """Adds a neighbour or image at -r [m] with the multiplier `other` [Pa]; the pressure of an
        image is larger by `excess` [Pa]."""
        weight = -r.dot(gradient)
        sums.others += weight * (other + excess)
        sums.weights += weight
        sums.trace += share * weight * (own + other + excess)
        if ti.static(with_stress):
            push = -share * (own + other + excess) * gradient
            found.normal += r * push
            found.shear += ti.Vector([r.y * push.z, r.x * push.z, r.x * push.y])

    @ti.func
    def image_acceleration(self, i, dt, gravity):
        """Returns the acceleration [m/s^2] of particle i by its images' excess pressure; stores the
        impulses in dt [s] on bodies for BodyLinks.record().

        The acceleration keeps the lowest sheet of particles from carrying half a sheet's weight too
        much. It is not conservative for particles that change places with particles of other size,
        so it fades out where these rise and adds no energy.
        """
        total = ti.Vector([0.0, 0.0, 0.0])
        for s in range(self.particles.first_image[i], self.particles.image_end[i]):
            total += self._by_image(i, s, gravity)
        d, size = (
            self.layers.spacing[self.particles.layer[i]],
            ti.max(total.norm(), MIN_ACCELERATION),
        )
        along = self.particles.v[i].dot(total) / size
        unlike = ti.min(ti.abs(self.particles.pair_spacing[i] / d - 1.0) / UNLIKE_SPACING, 1.0)
        fade = unlike * along / (FADE_SPEED * ti.sqrt(size * d))
        share = ti.math.clamp(1.0 - fade, 0.0, 1.0)
        if ti.static(self.traits.bodies):
            impulse = -share * dt * self.layers.mass[self.particles.layer[i]]
            for s in range(self.particles.body_image[i], self.particles.image_end[i]):
                push = impulse * self._by_image(i, s, gravity)
                self.links.push_at_face(self.images.link[s], push)
        return share * total

    @ti.func
    def _by_image(self, i, s, gravity):
        """Returns the acceleration [m/s^2] of particle i by the excess pressure of image s."""
        excess = self.image_excess(i, s, gravity)
        return -excess / self.constants.rest_density[None] * self.images.gradient[s]

    @ti.func
    def image_excess(self, i, s, gravity):
        """Returns the pressure [Pa] at image s of particle i less the pressure of its particle.

        No flow crosses a wall, so dp/dn = rho g.n there: behind a floor the pressure goes on
        rising. Its magnitude is at most the pressure of j, so that water passing by is not lifted.
        """
        j = self.images.index[s]
        most, place = self.particles.pressure_multiplier[j], self.images.place(i, s)
        rise = self.constants.rest_density[None] * gravity.dot(place - self.particles.x[j])
        return ti.math.clamp(rise, -most, most)
