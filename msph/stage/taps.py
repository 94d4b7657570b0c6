"""A tap and a drain at the cursor, open while the button is down."""

import numpy as np

from msph.fluid.boundary.opening import ZONE, Opening, Valve
from msph.fluid.external_forces import Hand
from msph.fluid.simulation import FullError, Simulation
from msph.stage.touch import Touch

# Radius of tap and drain over the box's breadth, and least radius in finest spacings.
RADIUS, LEAST_RADIUS = 0.05, 1.6
# Height of the tap above the water over the box's breadth, and speed of its water [m/s].
HEIGHT, SPEED = 0.2, 1.5
# Speed [m/s] at which a drain removes the water above its opening.
DRAIN_SPEED = 1.5
# Number of frames for which tap and drain stay open after the last frame with the button down.
HOLD = 1.5


def tap(touch: Touch) -> Hand:
    """Pours water from above the point at which the press began, as soon as there is room."""
    if touch.began or not touch.simulation.added_openings:
        size, d, radius = touch.size, touch.spacing, _radius(touch)
        # The zone above the tap must be inside the box.
        least = np.array([radius, d, radius])
        most = size - np.array([radius, (ZONE + 0.1) * d, radius])
        lifted = touch.surface + HEIGHT * touch.breadth * np.array((0.0, 1.0, 0.0))
        _open(touch, np.clip(lifted, least, np.maximum(most, least)), SPEED, enters=True)
    return _keep_open(touch)


def drain(touch: Touch) -> Hand:
    """Removes water at the floor below the point at which the press began."""
    if touch.began:
        radius, (x, _, z) = _radius(touch), touch.surface
        length, _, width = touch.size
        centre = [np.clip(x, radius, length - radius), 0.0, np.clip(z, radius, width - radius)]
        _open(touch, np.array(centre), DRAIN_SPEED, enters=False)
    return _keep_open(touch)


def _radius(touch: Touch) -> float:
    return max(RADIUS * touch.breadth, LEAST_RADIUS * touch.spacing)


def _open(touch: Touch, centre: np.ndarray, speed: float, enters: bool) -> None:
    """Replaces the opening of the last press. Raises FullError without room for it."""
    sim = touch.simulation
    close(sim)
    opening = Opening(
        centre,
        np.array((0.0, -1.0, 0.0)),
        (_radius(touch),) * 2,
        enters,
        Valve(speed),
        layer=sim.layers.finest_index,
    )
    try:
        sim.add_opening(opening, touch.box.gravity)
    except FullError:
        raise
    except ValueError as error:
        raise FullError(f"there is no room here: the opening {error}") from None


def close(sim: Simulation, closed_only: bool = False) -> None:
    """Removes the opening of the last press, or only one that has closed since: bodies would get
    stuck in the pipe of a closed tap, whose water rests."""
    for opening, valve in _openings(sim):
        if not closed_only or valve.until <= sim.time:
            sim.remove_opening(opening)


def _keep_open(touch: Touch) -> Hand:
    for _, valve in _openings(touch.simulation):
        valve.until = touch.simulation.time + HOLD * touch.step
    return Hand()


def _openings(sim: Simulation) -> list[tuple[Opening, Valve]]:
    """Returns the openings that the user added, and their valves."""
    return [(o, o.speed) for o in sim.added_openings if isinstance(o.speed, Valve)]
