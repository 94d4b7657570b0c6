"""Detection of water that a moving body compresses and that cannot flow away.

The pressure solve then has no solution: pressures grow without bound and steps shrink. Criterion:
sqrt(p/rho) exceeds TRAPPED_RATIO times the largest speed that bodies and gravity can cause.
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
    time: float,
) -> None:
    """Raises TrappedWaterError if water at moving bodies is trapped at `time` [s].

    longest_step [s] is the solver's limit: pressures are read only if it is very short.
    """
    fall = 2.0 * math.hypot(*external.apparent_gravity) * math.hypot(*boundary.box)
    speed = TRAPPED_RATIO * (boundary.top_speed + math.sqrt(fall))
    if longest_step > layers.finest.spacing / speed:
        return
    pressure = particles.numpy("pressure")
    top = int(np.argmax(pressure))
    if not pressure[top] < layers.finest.density * speed**2:
        body = boundary.nearest_moving(particles.numpy("x")[top])
        raise TrappedWaterError(body, boundary.name(body), time)
