"""Water that a moving body presses and that has nowhere to go.

No flow without compression satisfies such walls: the pressure solve has no solution, pressures grow
without bound, and steps shrink to nothing. It is told by a pressure that no motion of the scene
could cause: sqrt(p/rho) above TRAPPED_RATIO times every speed that bodies and gravity give.
"""

import math

import numpy as np

from msph.errors import MsphError
from msph.fluid.boundary.boundary import Boundary
from msph.fluid.external_forces import ExternalForces
from msph.fluid.particles.layers import Layers
from msph.fluid.particles.particles import Particles

# sqrt(p/rho) over the largest speed (-) that no impact on water with a free surface reaches in two
# seconds of the shipped scenes; a piston without a gap exceeds it within a few steps.
TRAPPED_RATIO = 100.0


class TrappedWaterError(MsphError):
    """A body presses water that has nowhere to go. body: its index in the boundary."""

    def __init__(self, body: int, name: str, time: float):
        self.body, self.name = body, name
        super().__init__(f"{name} presses water that has nowhere to go at t = {time:.3f} s")


def check_trapped_water(
    boundary: Boundary,
    layers: Layers,
    particles: Particles,
    external: ExternalForces,
    longest_step: float,
    time: float,
) -> None:
    """Raises TrappedWaterError if the water under moving bodies is trapped at `time` [s].

    longest_step [s] is what the solver allows: as long as it is not tiny, nothing is read.
    """
    fall = 2.0 * math.hypot(*external.gravity) * math.hypot(*boundary.box)
    speed = TRAPPED_RATIO * (boundary.top_speed + math.sqrt(fall))
    if longest_step > layers.finest.spacing / speed:
        return
    pressure = particles.numpy("pressure")
    top = int(np.argmax(pressure))
    if not pressure[top] < layers.finest.density * speed**2:
        body = boundary.nearest_moving(particles.numpy("x")[top])
        raise TrappedWaterError(body, boundary.name(body), time)
