"""Rigid bodies: blocks, balls and closed meshes, at rest or in prescribed motion.

Shapes are given at time zero in the box's frame. A pose is a function of time alone, so that resets
and checkpoints need no state.
"""

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from msph.fluid.particles.layers import LayerSpec

Vec3 = tuple[float, float, float]

# Gap below which a block counts as touching a wall, in spacings of the finest layer.
TOUCHING = 0.5


@dataclass(frozen=True)
class Motion:
    """Translation x(t) = velocity t + swing (1 - cos(2 pi t/period))/2 [m] and rotation at `rate`
    [rad/s] about `axis` through the body's centre. A swing starts at rest and reaches `swing` after
    half a period. velocity [m/s], swing [m], period [s]."""

    velocity: Vec3 = (0.0, 0.0, 0.0)
    swing: Vec3 = (0.0, 0.0, 0.0)
    period: float = 1.0
    axis: Vec3 = (0.0, 1.0, 0.0)
    rate: float = 0.0

    @property
    def spins(self) -> bool:
        """True if the body rotates."""
        return self.rate != 0.0

    @property
    def slides(self) -> np.ndarray:
        """Axes along which the body translates, (3,) bool."""
        return (np.array(self.velocity) != 0.0) | (np.array(self.swing) != 0.0)

    @property
    def moves(self) -> bool:
        """True if the body translates or rotates."""
        return self.spins or bool(self.slides.any())

    def offset(self, time: float) -> np.ndarray:
        """Returns the displacement since time zero [m], (3,)."""
        part = 0.5 - 0.5 * math.cos(2.0 * math.pi * time / self.period)
        return np.array(self.velocity) * time + np.array(self.swing) * part

    def rotation(self, time: float) -> np.ndarray:
        """Returns the rotation since time zero, (3, 3), by Rodrigues' formula."""
        x, y, z = self._axis
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        angle = self.rate * time
        return np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * cross @ cross

    def spin(self) -> np.ndarray:
        """Returns the angular velocity [rad/s], (3,)."""
        return self.rate * self._axis

    def top_speed(self, reach: float) -> float:
        """Returns an upper bound of the speed [m/s] of points within `reach` [m] of the centre."""
        swinging = math.pi / self.period * float(np.linalg.norm(self.swing))
        return float(np.linalg.norm(self.velocity)) + swinging + abs(self.rate) * reach

    @cached_property
    def _axis(self) -> np.ndarray:
        axis = np.array(self.axis, float)
        return axis / np.linalg.norm(axis)


AT_REST = Motion()


@dataclass(frozen=True, eq=False)
class Block:
    """Box from lo to hi [m], (3,) each."""

    lo: np.ndarray
    hi: np.ndarray
    motion: Motion = AT_REST

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        return self.lo, self.hi


@dataclass(frozen=True, eq=False)
class Ball:
    """Ball: centre (3,) [m], radius [m]."""

    centre: np.ndarray
    radius: float
    motion: Motion = AT_REST

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        return self.centre - self.radius, self.centre + self.radius


@dataclass(frozen=True, eq=False)
class Solid:
    """Closed mesh: vertices (v, 3) [m], triangles (t, 3) counter-clockwise seen from outside.

    container: True if the water is inside the mesh; the walls of the box then only stop particles
    that would leave the box.
    """

    vertices: np.ndarray
    triangles: np.ndarray
    motion: Motion = AT_REST
    container: bool = field(default=False)

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        return self.vertices.min(axis=0), self.vertices.max(axis=0)


Body = Block | Ball | Solid


def centre(body: Body) -> np.ndarray:
    """Returns the centre of the body's bounds [m], (3,), about which it rotates."""
    lo, hi = body.bounds
    return 0.5 * (lo + hi)


def bounding_radius(body: Body) -> float:
    """Returns the radius [m] of a ball about the centre that contains the body."""
    if isinstance(body, Ball):
        return body.radius
    lo, hi = body.bounds
    return 0.5 * float(np.linalg.norm(hi - lo))


def extended_into_walls(body: Body, walls: np.ndarray, specs: list[LayerSpec]) -> Body:
    """Returns a block whose faces that touch a wall of the box, at 0 or `walls` (3,) [m], are moved
    out beyond the kernels' reach.

    Faces along axes of motion stay, since a gap may open there; other bodies are returned
    unchanged.
    """
    if not isinstance(body, Block) or body.motion.spins:
        return body
    touching = TOUCHING * min(s.spacing for s in specs)
    far = 2.0 * max(s.support for s in specs)
    fixed = ~body.motion.slides
    lo = np.where(fixed & (body.lo < touching), np.minimum(body.lo, -far), body.lo)
    hi = np.where(fixed & (body.hi > walls - touching), np.maximum(body.hi, walls + far), body.hi)
    return Block(lo, hi, body.motion)
