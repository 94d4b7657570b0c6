"""End wall of the box that the user drags: a piston until the wall is back in its place."""

import math

import numpy as np

from msph.fluid.boundary.pistons import Stroke
from msph.fluid.boundary.rigid_bodies import bounding_radius, half_extents
from msph.fluid.external_forces import Hand
from msph.fluid.simulation import FullError, Simulation
from msph.stage import taps
from msph.stage.touch import Touch

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


def use(touch: Touch) -> Hand:
    """Drags the end wall nearest to the press along the longer side of the box. Keeps the place of
    the wall [m] at the press, and its longest stroke [m]."""
    sim, size = touch.simulation, touch.size
    axis = 0 if size[0] >= size[2] else 2
    stroke = Stroke(1 << axis if touch.start[axis] < 0.5 * size[axis] else 8 << axis)
    if touch.began:
        taps.close(sim)
        if sim.piston and sim.piston.wall != stroke.wall:
            sim.remove_piston()
        longest = _longest(sim, stroke)
        if not sim.piston:
            sim.add_piston(stroke)
        touch.kept = sim.piston.at(sim.time)[0], longest  # type: ignore[union-attr]
    if touch.kept is not None and sim.piston:
        before, longest = touch.kept
        way = before + (touch.place - touch.start) @ stroke.inwards
        touch.wall = float(np.clip(way, 0.0, longest))
    return Hand()


def follow(sim: Simulation, gravity: float, step: float, asked: float | None) -> None:
    """Lets the piston of a simulation, if any, follow the user to the place `asked` [m] in a frame
    of `step` [s], or return to its wall, where the piston is removed; gravity [m/s^2]."""
    if sim.piston is None:
        return
    place, speed = sim.piston.at(sim.time)
    if asked is None and place < HOME * sim.layers.finest.spacing:
        sim.remove_piston()
        return
    length = max(sim.size)
    way, unit = (asked or 0.0) - place, math.sqrt(length / gravity)
    fastest, change = SPEED * length / unit, ACCELERATION * gravity * step
    wanted = way / max(REACHING * unit, FRAMES * step)
    wanted = min(max(wanted, -fastest, speed - change), fastest, speed + change)
    sim.piston.steer(sim.time, wanted, step)


def _longest(sim: Simulation, stroke: Stroke) -> float:
    """Returns the longest stroke [m] of a wall. Raises FullError without room."""
    axis, boundary = stroke.axis, sim.boundary
    length = sim.size[axis]
    spans = []
    for b, body in enumerate(boundary.bodies):
        # A piston pushes floating bodies away.
        if body.mass is None and not isinstance(body.motion, Stroke):
            half = bounding_radius(body) if body.motion.spins else half_extents(body)[axis]
            spans.append((boundary.centre_at_end(b)[axis], half))
    spans += [(o.centre[axis], max(o.half) * math.sqrt(2.0)) for o in sim.openings.all]
    near = [(c if stroke.wall < 8 else length - c) - half for c, half in spans]
    spacing = sim.layers.finest.spacing
    free = min([LONGEST * length, *(gap - GAP * spacing for gap in near)])
    if boundary.container is not None or free < LEAST * spacing:
        raise FullError("there is no room for a moving wall at this end")
    return free
