"""Floating bodies under the cursor: finding, throwing in, dragging and releasing them."""

import math
from dataclasses import replace

import numpy as np

from msph.fluid.boundary.boundary import Boundary
from msph.fluid.boundary.rigid_bodies import (
    Ball,
    Block,
    Motion,
    bounding_radius,
    half_extents,
    volume,
)
from msph.fluid.external_forces import Hand, as_vector
from msph.stage.touch import Touch, limited

# Radius of a thrown ball, and half the edge of a thrown cube, over the box's breadth; least
# value of both in finest spacings; density over the water's.
SIZE, LEAST_SIZE, DENSITY = 0.07, 2.5, 0.4
# Albedo of thrown bodies in turn, linear RGB: red, yellow, blue, green.
PAINTS = (0.56, 0.04, 0.03), (0.76, 0.40, 0.02), (0.03, 0.15, 0.50), (0.06, 0.34, 0.08)
# Distances in radii of a thrown body from the water, and from walls at least; its speed over
# sqrt(g L) of the box's longest edge L.
DISTANCE, ROOM, SPEED = 2.5, 1.05, 0.4
# Time in which a dragged body reaches the cursor [s], and its largest speed over sqrt(g L).
DRAG_TIME, DRAG_SPEED = 0.1, 1.5


def floating_at(
    boundary: Boundary, eye: np.ndarray, direction: np.ndarray
) -> tuple[int, np.ndarray] | None:
    """Returns the nearest floating body that a ray from eye (3,) [m] meets: its index among all
    bodies and the point [m]; None without one. Meshes count as their bounding boxes."""
    floating, found = boundary.floating, []
    for k, b in enumerate(floating.which):
        body, turn = boundary.bodies[b], floating.turn[k]
        p, r = (eye - floating.x[k]) @ turn, direction @ turn
        if isinstance(body, Ball):
            root = (p @ r) ** 2 - p @ p + body.radius**2
            near, far = (-p @ r - math.sqrt(root), math.inf) if root > 0.0 else (0.0, 0.0)
        else:
            per = 1.0 / np.where(np.abs(r) > 1e-12, r, 1e-12)
            faces = np.stack([-half_extents(body) - p, half_extents(body) - p]) * per
            near, far = float(faces.min(axis=0).max()), float(faces.max(axis=0).min())
        if 0.0 < near <= far:
            found.append((near, int(b)))
    if not found:
        return None
    near, which = min(found)
    return which, eye + near * direction


def use(touch: Touch) -> Hand:
    """Drags the floating body that the press began on; a press elsewhere throws in a new body.
    Keeps the number of the floating body, and its centre relative to the cursor [m]."""
    boundary = touch.simulation.boundary
    if touch.began:
        eye = touch.place - 2.0 * float(np.linalg.norm(touch.size)) * touch.direction
        hit = floating_at(boundary, eye, touch.direction)
        if hit and np.linalg.norm(hit[1] - touch.place) < bounding_radius(boundary.bodies[hit[0]]):
            k = int(np.searchsorted(boundary.floating.which, hit[0]))
            touch.kept = k, boundary.floating.x[k] - touch.place
        else:
            _throw(touch)
    elif touch.kept is not None:
        _drag(touch, *touch.kept)
    return Hand()


def _drag(touch: Touch, k: int, offset: np.ndarray) -> None:
    """Gives floating body k the velocity at which it follows the cursor, `offset` [m] from it."""
    floating = touch.simulation.boundary.floating
    if floating.held[k]:
        return
    wanted = limited((touch.place + offset - floating.x[k]) / DRAG_TIME, DRAG_SPEED * touch.fall)
    change = np.zeros((floating.count, 3))
    change[k] = floating.mass[k] * (wanted - floating.v[k])
    impulses, middle = touch.simulation.world.parts.impulses, 0.5 * (wanted + floating.v[k])
    impulses.add_user(as_vector(change[k]), float(change[k] @ middle))
    floating.push(change, np.zeros_like(change))


def _throw(touch: Touch) -> None:
    """Throws a ball onto the water, or a cube if the number of floating bodies is odd."""
    number = touch.simulation.boundary.floating.count
    half = max(SIZE * touch.breadth, LEAST_SIZE * touch.spacing)
    x, velocity = touch.aim(ROOM * half, DISTANCE * half, SPEED)
    motion = Motion(as_vector(velocity))
    body: Ball | Block = Ball(x, half, motion)
    if number % 2:
        body = Block(x - half, x + half, motion)
    density = DENSITY * touch.simulation.layers.finest.density
    paint = PAINTS[number % len(PAINTS)]
    touch.add_body(replace(body, mass=density * volume(body), albedo=paint))
