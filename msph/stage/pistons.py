"""End wall of the box that the user drags: a piston until the wall is back in its place."""

import math
from typing import TYPE_CHECKING

import numpy as np

from msph.fluid.boundary.boundary import Boundary
from msph.fluid.boundary.pistons import Stroke
from msph.fluid.boundary.rigid_bodies import bounding_radius, half_extents
from msph.fluid.external_forces import Hand
from msph.fluid.simulation import FullError
from msph.stage import taps

if TYPE_CHECKING:
    from msph.stage.show import Show
    from msph.stage.tools import Touch

# Longest stroke over the length of the box; its least value, and gap to bodies and openings, in
# finest spacings.
LONGEST, LEAST, GAP = 0.4, 3.0, 2.0
# Largest speed over sqrt(g L), largest acceleration over g, and time over sqrt(L/g) in which the
# wall reaches the cursor, L the longest edge of the box; braking needs less than ACCELERATION.
SPEED, ACCELERATION, REACHING = 0.8, 3.0, 0.4
# Least time in which the wall reaches the cursor, in frames; with less the wall would oscillate.
FRAMES = 3.0
# Distance from its wall at which a released piston is removed, in finest spacings.
HOME = 0.02


def use(touch: "Touch") -> Hand:
    """Drags the end wall nearest to the press along the longer side of the box."""
    show, size = touch.show, touch.size
    axis = 0 if size[0] >= size[2] else 2
    stroke = Stroke(1 << axis if touch.start[axis] < 0.5 * size[axis] else 8 << axis)
    sim = show.simulation
    if touch.began:
        show.grip = None
        taps.close(show)
        if sim.piston and sim.piston.wall != stroke.wall:
            sim.remove_piston()
        longest = _longest(show, stroke)
        if not sim.piston:
            sim.add_piston(stroke)
        show.grip = sim.piston.at(sim.time)[0], longest  # type: ignore[union-attr]
    if show.grip is not None and sim.piston:
        before, longest = show.grip
        way = before + (touch.place - touch.start) @ stroke.inwards
        show.wall_place = float(np.clip(way, 0.0, longest))
    return Hand()


def follow(show: "Show", step: float) -> None:
    """Lets the piston of a show, if any, follow the user in a frame of `step` [s], or return to its
    wall, where the piston is removed."""
    sim, held, show.wall_place = show.simulation, show.wall_place, None
    if sim.piston is None:
        return
    place, speed = sim.piston.at(sim.time)
    if held is None and place < HOME * sim.layers.finest.spacing:
        sim.remove_piston()
        return
    gravity, length = show.tool_gravity, max(sim.size)
    way, unit = (held or 0.0) - place, math.sqrt(length / gravity)
    fastest, change = SPEED * length / unit, ACCELERATION * gravity * step
    wanted = way / max(REACHING * unit, FRAMES * step)
    wanted = min(max(wanted, -fastest, speed - change), fastest, speed + change)
    sim.piston.steer(sim.time, wanted, step)


def _longest(show: "Show", stroke: Stroke) -> float:
    """Returns the longest stroke [m] of a wall. Raises FullError without room."""
    sim, axis = show.simulation, stroke.axis
    boundary, length = sim.boundary, sim.size[axis]
    spans = [_span(boundary, b, axis) for b in range(boundary.count) if _stays(boundary, b)]
    for opening in sim.openings.all:
        reach = max(opening.half) * math.sqrt(2.0)
        spans.append((opening.centre[axis] - reach, opening.centre[axis] + reach))
    near = [lo if stroke.wall < 8 else length - hi for lo, hi in spans]
    spacing = sim.layers.finest.spacing
    free = min([LONGEST * length, *(gap - GAP * spacing for gap in near)])
    if boundary.container is not None or free < LEAST * spacing:
        raise FullError("there is no room for a moving wall at this end")
    return free


def _stays(boundary: Boundary, b: int) -> bool:
    """Returns True for a body that a piston cannot push away."""
    body = boundary.bodies[b]
    return body.mass is None and not isinstance(body.motion, Stroke)


def _span(boundary: Boundary, b: int, axis: int) -> tuple[float, float]:
    """Returns the range [m] along an axis in which a body is now."""
    body, centre = boundary.bodies[b], boundary.centre_at_end(b)[axis]
    half = bounding_radius(body) if body.motion.spins else half_extents(body)[axis]
    return centre - half, centre + half
