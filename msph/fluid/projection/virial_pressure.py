"""Pressure in the water, from the multipliers that a velocity solve found.

A multiplier p_i is no pressure of its own: i and j press on each other with
V_i V_j (p_i + p_j) grad W_ij, and weight is borne by all pairs across a plane. So the pressure at a
particle is the mean of (p_i + p_j)/2 over its pairs, weighed as in the virial by -r_ij.grad W_ij
(Irving and Kirkwood 1950). At surfaces and between layers multipliers fall short of it by up to 5 %
of rho g H (docs/method.md, "Pressure"). Bodies are no pairs: beside them the mean is over the
water's side alone.
"""

import taichi as ti

from msph.fluid.particles.layers import Layers
from msph.fluid.particles.neighbour_list import NeighbourList
from msph.fluid.particles.particles import Particles
from msph.taichi_internals import data_oriented

# Sum of the weights (-) from which on there is a mean; 3 in bulk.
LEAST_WEIGHT = 1e-6
# Weight (-) of a particle as its own neighbour in spacing(): decides only where it has none.
ALONE = 1e-3


@data_oriented
class VirialPressure:
    """Reads particles' `pressure_multiplier` [Pa]; pair_gradient holds V_j grad W_ij [1/m] of each
    entry of the neighbour list; rest_density [kg/m^3]."""

    def __init__(
        self,
        layers: Layers,
        particles: Particles,
        neighbours: NeighbourList,
        pair_gradient: ti.MatrixField,
        rest_density: float,
    ):
        self.layers, self.particles, self.neighbours = layers, particles, neighbours
        self.images, self.pair_gradient = neighbours.images, pair_gradient
        self.rest_density = rest_density

    @ti.func
    def at(self, i, gravity):
        """Pressure [Pa] at particle i; of a lone particle its own multiplier."""
        x, own = self.particles.x[i], self.particles.pressure_multiplier[i]
        others, weights = 0.0, 0.0
        for mirrored in ti.static((False, True)):
            begin, end = self.neighbours.span(i, mirrored)
            for s in range(begin, end):
                j, mirror, wall = self.neighbours.read(s, mirrored)
                r_ij = self.images.offset(x, self.particles.x[j], mirror, wall)
                weight = -r_ij.dot(self.pair_gradient[s])
                other = self.particles.pressure_multiplier[j]
                if ti.static(mirrored):
                    other += self.image_excess(x - r_ij, j, gravity)
                others += weight * other
                weights += weight
        mean = ti.select(weights > LEAST_WEIGHT, others / ti.max(weights, LEAST_WEIGHT), own)
        return 0.5 * (own + mean)

    @ti.func
    def spacing(self, i):
        """Spacing [m] of equal particles among which pressure would hold i as stiffly in place.

        It pulls by sum V_j (p_i + p_j)/rho0 W''_ij, W'' as 1/h_ij^5: so it is the mean of 1/h_ij^2,
        weighed by V_j/h_ij^3. By its own spacing a single fine particle that waves had drawn down
        among coarse ones halved all steps of a pool.
        """
        layer = self.particles.layer[i]
        d = self.layers.spacing[layer]
        if ti.static(self.layers.count > 1):
            own = self.layers.per_h[layer, layer]
            weights = ALONE * self.layers.volume[layer] * own**3
            stiffness = weights * own**2
            for s in range(self.neighbours.start[i], self.neighbours.mirrors[i]):
                other = self.particles.layer[self.neighbours.index[s]]
                per_h = self.layers.per_h[layer, other]
                weight = self.layers.volume[other] * per_h**3
                weights += weight
                stiffness += weight * per_h**2
            d *= own * ti.sqrt(weights / stiffness)
        return d

    @ti.func
    def image_acceleration(self, i, gravity):
        """Acceleration [m/s^2] by the excess pressure of the mirror images round particle i.

        Without it the lowest sheet bears half a sheet's weight too much.
        """
        x, total = self.particles.x[i], ti.Vector([0.0, 0.0, 0.0])
        for s in range(self.neighbours.mirrors[i], self.neighbours.end[i]):
            j, mirror, wall = self.images.read(self.neighbours.index[s])
            seen_at = x - self.images.offset(x, self.particles.x[j], mirror, wall)
            total -= self.image_excess(seen_at, j, gravity) * self.pair_gradient[s]
        return total / self.rest_density

    @ti.func
    def image_excess(self, seen_at, j, gravity):
        """Pressure [Pa] of the image of j, seen at a point [m], over that of j itself.

        No flow crosses a wall, so there dp/dn = rho g.n: behind a floor the pressure goes on
        rising. At most the particle's own, so that water that only passes by is not lifted.
        """
        own = self.particles.pressure_multiplier[j]
        weight = self.rest_density * gravity.dot(seen_at - self.particles.x[j])
        return ti.math.clamp(weight, -own, own)
