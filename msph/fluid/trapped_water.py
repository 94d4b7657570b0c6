"""Detection of water that a moving body compresses and that cannot flow away.

The pressure solve then has no solution: the density rises, or pressures grow without bound and
steps shrink. Criteria: the mean density around the densest particle, at a body, exceeds the rest
density by TRAPPED_EXCESS; sqrt(p/rho) exceeds TRAPPED_RATIO times the sum of the speed of the
fastest particle and of the largest speed that bodies and gravity can cause.
"""

import math

import numpy as np

from msph.errors import MsphError
from msph.fluid.boundary.boundary import Boundary
from msph.fluid.external_forces import ExternalForces
from msph.fluid.particles.layers import Layers
from msph.fluid.particles.particles import Particles

# Ratio (-) of sqrt(p/rho) to the largest speed: no impact of the shipped scenes reaches it in 2 s,
# and a piston without a gap exceeds it within a few steps.
TRAPPED_RATIO = 100.0
# Least speed [m/s] in these comparisons: without gravity and motion, pressures of rounding errors
# would exceed those of zero speed. Nothing slower is seen.
LEAST_SPEED = 1e-3
# Mean density excess (-) within TRAPPED_REACH supports: single particles of the shipped scenes
# reach a third (`lock`), 99 % of them stay below 0.4 %.
TRAPPED_EXCESS, TRAPPED_REACH = 0.1, 2.0


class TrappedWaterError(MsphError):
    """A body compresses water that cannot flow away. body: its index in the boundary."""

    def __init__(self, body: int, name: str, time: float):
        self.body, self.name = body, name
        super().__init__(f"{name} compresses water that cannot flow away at t = {time:.3f} s")


def check_trapped_water(
    boundary: Boundary,
    layers: Layers,
    particles: Particles,
    external: ExternalForces,
    longest_step: float,
    largest_excess: float,
    time: float,
) -> None:
    """Raises TrappedWaterError if water at moving bodies is trapped at `time` [s].

    longest_step [s] is the solver's limit, largest_excess (-) of the density: particles are read
    only if the former is very short or the latter is large.
    """
    if largest_excess > TRAPPED_EXCESS:
        body = _compressing_body(boundary, layers, particles)
        if body is not None and boundary.stopped.get(body, math.inf) > time:
            raise TrappedWaterError(body, boundary.name(body), time)
    fall = 2.0 * math.hypot(*external.apparent_gravity) * math.hypot(*boundary.box)
    caused = boundary.top_speed + math.sqrt(fall)
    if max(caused, LEAST_SPEED) * longest_step > layers.finest.spacing / TRAPPED_RATIO:
        return
    pressure, flow = particles.numpy("pressure"), np.linalg.norm(particles.numpy("v"), axis=1).max()
    top, speed = int(np.argmax(pressure)), TRAPPED_RATIO * (caused + max(flow, LEAST_SPEED))
    if not pressure[top] < layers.finest.density * speed**2:
        body = boundary.nearest_moving(particles.numpy("x")[top])
        raise TrappedWaterError(body, boundary.name(body), time)


def _compressing_body(boundary: Boundary, layers: Layers, particles: Particles) -> int | None:
    """Returns the moving body that is nearest to the densest particle if a body touches the water
    around it and the mean density of this water exceeds the limit; otherwise None."""
    x, layer = particles.numpy("x").astype(float), particles.numpy("layer")
    density = particles.numpy("density").astype(float)
    top = int(np.argmax(density))
    spec = layers.specs[layer[top]]
    near = np.linalg.norm(x - x[top], axis=1) < TRAPPED_REACH * spec.support
    mass = np.array([s.mass for s in layers.specs])[layer]
    mean = np.average(density[near], weights=mass[near])
    if mean <= (1.0 + TRAPPED_EXCESS) * spec.density or boundary.free(x[near], spec.spacing).all():
        return None
    return boundary.nearest_moving(x[top])
