"""Pressure in the water, from the multipliers that a velocity solve found.

A multiplier p_i is no pressure of its own: i and j press on each other with
V_i V_j (p_i + p_j) grad W_ij, and weight is borne by all pairs across a plane. So the pressure at a
particle is the mean of (p_i + p_j)/2 over its pairs, weighed as in the virial by -r_ij.grad W_ij
(Irving and Kirkwood 1950). Multipliers fall short of it where a particle's pairs reach farther down
than up, at surfaces and between layers: by 5 % of rho g H at the surface of water ten spacings
deep, by 1.5 % within it in thin bands of layers; the means by 1.4 and .3 %. Bodies are no pairs:
beside them the mean is over the water's side alone.
"""

import taichi as ti

from msph.fluid.layers import Layers
from msph.fluid.neighbours import NeighbourList
from msph.fluid.particles import Particles
from msph.launch import data_oriented

# Sum of the weights (-) from which on there is a mean; 3 in bulk.
LEAST_WEIGHT = 1e-6
# Weight of a particle as if it met its like, over its own: decides only where it meets none.
ALONE = 1e-3


@data_oriented
class PairPressure:
    """Reads particles' `multiplier`s; pair_gradient holds V_j grad W_ij [1/m] of each entry of the
    neighbour list."""

    def __init__(
        self,
        layers: Layers,
        particles: Particles,
        neighbours: NeighbourList,
        pair_gradient: ti.MatrixField,
    ):
        self.layers, self.particles, self.neighbours = layers, particles, neighbours
        self.images, self.pair_gradient = neighbours.images, pair_gradient

    @ti.func
    def at(self, i, gravity, scale):
        """p/rho0 [m^2/s^2] at particle i, where p_j/rho0 is scale times its multiplier; of a lone
        particle its own."""
        x, own = self.particles.x[i], scale * self.particles.multiplier[i]
        others, weights = 0.0, 0.0
        for s in range(self.neighbours.start[i], self.neighbours.mirrors[i]):
            j = self.neighbours.index[s]
            weight = (self.particles.x[j] - x).dot(self.pair_gradient[s])
            others += weight * scale * self.particles.multiplier[j]
            weights += weight
        for s in range(self.neighbours.mirrors[i], self.neighbours.end[i]):
            j, mirror, wall = self.images.read(self.neighbours.index[s])
            r_ij = self.images.offset(x, self.particles.x[j], mirror, wall)
            weight = -r_ij.dot(self.pair_gradient[s])
            other = scale * self.particles.multiplier[j]
            others += weight * (other + self.more(x - r_ij, j, gravity, other))
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
    def lift(self, i, gravity, scale):
        """Acceleration [m/s^2] by what images have more pressure than their particles.

        Without it the lowest sheet bears half a sheet's weight too much.
        """
        x, lift = self.particles.x[i], ti.Vector([0.0, 0.0, 0.0])
        for s in range(self.neighbours.mirrors[i], self.neighbours.end[i]):
            j, mirror, wall = self.images.read(self.neighbours.index[s])
            seen_at = x - self.images.offset(x, self.particles.x[j], mirror, wall)
            other = scale * self.particles.multiplier[j]
            lift -= self.more(seen_at, j, gravity, other) * self.pair_gradient[s]
        return lift

    @ti.func
    def more(self, seen_at, j, gravity, own):
        """What the image of j has more than its `own` p_j/rho0 [m^2/s^2].

        No flow crosses a wall, so there dp/dn = rho g.n: behind a floor the pressure goes on
        rising. At most the particle's own, so that water that only passes by is not lifted.
        """
        return ti.math.clamp(gravity.dot(seen_at - self.particles.x[j]), -own, own)
