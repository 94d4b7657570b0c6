"""Rigid bodies: blocks, balls and closed meshes, in prescribed motion or floating.

Shapes are given at time zero in the box's frame. The pose of a body in prescribed motion is a
function of time alone; floating.py holds the state of floating bodies.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from msph.fluid.boundary.pistons import Stroke
from msph.fluid.external_forces import Vec3
from msph.fluid.particles.layers import LayerSpec

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
        """Returns the rotation since time zero, (3, 3)."""
        return rotations(self.rate * time * self._axis[None])[0]

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


@dataclass(frozen=True)
class Scripted:
    """Motion by a function: place(t) is the displacement [m], (3,), and the angle [rad] of the
    rotation about `axis` through the point `pivot` (3,) [m], relative to the body's centre at time
    zero. Upper bound of the speed of the body's points: speed [m/s], plus rate [rad/s] times the
    distance from the centre. slides: axes along which the body translates."""

    place: Callable[[float], tuple[np.ndarray, float]]
    axis: Vec3
    pivot: np.ndarray
    speed: float
    rate: float = 0.0
    slides: Any = field(default_factory=lambda: np.ones(3, bool))
    spins: bool = True
    moves: bool = True

    def offset(self, time: float) -> np.ndarray:
        """Returns the displacement of the centre since time zero [m], (3,)."""
        return self._pose(time)[0]

    def rotation(self, time: float) -> np.ndarray:
        """Returns the rotation since time zero, (3, 3)."""
        return self._pose(time)[1]

    @cached_property
    def _pose(self) -> Callable[[float], tuple[np.ndarray, np.ndarray]]:
        """Function that returns the offset [m] and rotation at a time [s], and keeps them, since a
        step needs each of its three poses several times."""
        axis = np.array(self.axis, float) / np.linalg.norm(self.axis)

        @lru_cache(POSES)
        def pose(time: float) -> tuple[np.ndarray, np.ndarray]:
            shift, angle = self.place(time)
            turn = rotations(angle * axis[None])[0]
            return shift + self.pivot - turn @ self.pivot, turn

        return pose

    def top_speed(self, reach: float) -> float:
        """Returns an upper bound of the speed [m/s] of points within `reach` [m] of the centre."""
        return self.speed + self.rate * reach


def rotations(vectors: np.ndarray) -> np.ndarray:
    """Returns the rotations (n, 3, 3) by rotation vectors (n, 3) [rad]."""
    # Arithmetic of arrays takes ten times as long for few vectors.
    return np.array([_rotation(*vector) for vector in vectors.tolist()]).reshape(-1, 3, 3)


def _rotation(*vector: float) -> list[list[float]]:
    """Returns the rotation by a rotation vector [rad], by Rodrigues' formula."""
    angle = math.hypot(*vector)
    x, y, z = (part / max(angle, TINY) for part in vector)
    sine, cosine = math.sin(angle), math.cos(angle)
    rest = 1.0 - cosine
    return [
        [cosine + rest * x * x, rest * x * y - sine * z, rest * x * z + sine * y],
        [rest * x * y + sine * z, cosine + rest * y * y, rest * y * z - sine * x],
        [rest * x * z - sine * y, rest * y * z + sine * x, cosine + rest * z * z],
    ]


AnyMotion = Motion | Scripted | Stroke
# Poses that a scripted motion keeps (-): of the times of one step and the next.
POSES = 16
AT_REST = Motion()
TINY = float(np.finfo(float).tiny)
# Coefficient of friction between bodies, and with walls (-): of wood on wood.
FRICTION = 0.3

# A body with a mass [kg] floats from the time `release` [s] on: until then it is held at rest, and
# its motion gives velocity and spin at that time. A body without a mass follows its motion.
# albedo: reflected share of light, linear RGB, in images; None: clay, or glaze for a container.


@dataclass(frozen=True, eq=False)
class Block:
    """Box from lo to hi [m], (3,) each. name: of a wave maker or piston."""

    lo: np.ndarray
    hi: np.ndarray
    motion: AnyMotion = AT_REST
    mass: float | None = None
    friction: float = FRICTION
    release: float = 0.0
    albedo: Vec3 | None = None
    name: str = ""

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        return self.lo, self.hi


@dataclass(frozen=True, eq=False)
class Ball:
    """Ball: centre (3,) [m], radius [m]."""

    centre: np.ndarray
    radius: float
    motion: AnyMotion = AT_REST
    mass: float | None = None
    friction: float = FRICTION
    release: float = 0.0
    albedo: Vec3 | None = None

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        return self.centre - self.radius, self.centre + self.radius


@dataclass(frozen=True, eq=False)
class Solid:
    """Closed mesh: vertices (v, 3) [m], triangles (t, 3) counter-clockwise seen from outside.

    container: True if the water is inside the mesh; the walls of the box then only stop particles
    that would leave the box. paint (t, 3): albedos of the triangles, instead of one albedo.
    """

    vertices: np.ndarray
    triangles: np.ndarray
    motion: AnyMotion = AT_REST
    mass: float | None = None
    friction: float = FRICTION
    release: float = 0.0
    albedo: Vec3 | None = None
    container: bool = field(default=False)
    paint: np.ndarray | None = None

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        return self.vertices.min(axis=0), self.vertices.max(axis=0)

    @cached_property
    def moments(self) -> tuple[float, np.ndarray, np.ndarray]:
        """Volume [m^3], centre of mass [m] and inertia about it [m^5] at density 1, as sums over
        the tetrahedra between each triangle and one point (Blow and Binstock 2004)."""
        origin = 0.5 * sum(self.bounds)
        corners = self.vertices[self.triangles] - origin
        parts, sums = np.linalg.det(corners) / 6.0, corners.sum(axis=1)
        volume = float(parts.sum())
        first = parts @ sums / (4.0 * volume)
        second = np.einsum("t,ti,tj->ij", parts, sums, sums)
        second += np.einsum("t,tki,tkj->ij", parts, corners, corners)
        second = second / 20.0 - volume * np.outer(first, first)
        return volume, origin + first, np.trace(second) * np.eye(3) - second


Body = Block | Ball | Solid


def centre(body: Body) -> np.ndarray:
    """Returns the point [m], (3,), about which a body rotates: the centre of mass of a floating
    mesh, otherwise the centre of the bounds."""
    if isinstance(body, Solid) and body.mass is not None:
        return body.moments[1]
    lo, hi = body.bounds
    return 0.5 * (lo + hi)


def volume(body: Body) -> float:
    """Returns the volume of a body [m^3]."""
    if isinstance(body, Solid):
        return body.moments[0]
    if isinstance(body, Ball):
        return 4.0 / 3.0 * math.pi * body.radius**3
    return float(np.prod(body.hi - body.lo))


def inertia(body: Body) -> np.ndarray:
    """Returns the inertia (3, 3) [kg m^2] of a floating body of uniform density about its centre
    of mass, in its frame."""
    assert body.mass is not None
    if isinstance(body, Solid):
        return body.mass / volume(body) * body.moments[2]
    if isinstance(body, Ball):
        return 0.4 * body.mass * body.radius**2 * np.eye(3)
    squares = (body.hi - body.lo) ** 2
    return body.mass / 12.0 * np.diag(squares.sum() - squares)


def half_extents(body: Body) -> np.ndarray:
    """Returns the largest distances [m] of the body's points from its centre along the axes of its
    frame, (3,)."""
    lo, hi = body.bounds
    return np.maximum(hi - centre(body), centre(body) - lo)


def bounding_radius(body: Body) -> float:
    """Returns the radius [m] of a ball about the centre that contains the body."""
    if isinstance(body, Ball):
        return body.radius
    return float(np.linalg.norm(half_extents(body)))


def end_block(
    size: Vec3, reach: float, inwards: np.ndarray, face: float, motion: AnyMotion, name: str
) -> Block:
    """Returns the block that fills the cross-section of a box of `size` [m] up to its rim, from far
    beyond the wall that `inwards` (3,) points away from to a face at the distance `face` [m] from
    this wall. reach [m]: of the kernels."""
    axis, edges = int(np.abs(inwards).argmax()), np.array(size)
    lo, hi = np.full(3, -2.0 * reach), edges + 2.0 * reach
    hi[1] = edges[1]
    if inwards[axis] > 0.0:
        hi[axis] = face
    else:
        lo[axis] = edges[axis] - face
    return Block(lo, hi, motion, name=name)


def extended_into_walls(body: Body, walls: np.ndarray, specs: list[LayerSpec]) -> Body:
    """Returns a block whose faces that touch a wall of the box, at 0 or `walls` (3,) [m], are moved
    out beyond the kernels' reach.

    Faces along axes of motion stay, since a gap may open there; other bodies are returned
    unchanged.
    """
    if not isinstance(body, Block) or body.motion.spins or body.mass is not None:
        return body
    touching = TOUCHING * min(s.spacing for s in specs)
    far = 2.0 * max(s.support for s in specs)
    fixed = ~body.motion.slides
    lo = np.where(fixed & (body.lo < touching), np.minimum(body.lo, -far), body.lo)
    hi = np.where(fixed & (body.hi > walls - touching), np.maximum(body.hi, walls + far), body.hi)
    return replace(body, lo=lo, hi=hi)
