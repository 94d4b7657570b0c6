"""Triangle meshes of bodies, and points spread over their faces."""

import math
from typing import TYPE_CHECKING

import numpy as np

from msph.fluid.boundary.rigid_bodies import Ball, Block, Body, Solid, centre, half_extents

if TYPE_CHECKING:
    import trimesh

# Subdivisions of an icosahedron for an exported ball: 1280 faces, which enclose 0.15 % less than
# the ball's volume when scaled to its area.
SUBDIVISIONS = 3
# Rings of a ball's triangles from pole to pole: outlines are within 0.3 % of the radius.
RINGS = 16
# Edge of the cells in which samples are merged, over the longest edge of triangles (-). At 1, a
# ball of 320 triangles and 4 spacings radius, a spacing above the floor, loses 2 % of its buoyancy.
MERGED = 0.5
# The six faces of the unit cube: corner, and both edges, counter-clockwise from outside.
CUBE_FACES = [
    ((0, 0, 0), (0, 0, 1), (0, 1, 0)),
    ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    ((0, 0, 0), (1, 0, 0), (0, 0, 1)),
    ((0, 1, 0), (0, 0, 1), (1, 0, 0)),
    ((0, 0, 0), (0, 1, 0), (1, 0, 0)),
    ((0, 0, 1), (1, 0, 0), (0, 1, 0)),
]


def triangles_of(body: Body) -> np.ndarray:
    """Returns the triangles of a body [m], (t, 3, 3), in its frame, counter-clockwise from
    outside; those of a ball enclose its volume."""
    if isinstance(body, Ball):
        return body.radius * _ball()
    if isinstance(body, Block):
        corner, a, b = np.array(CUBE_FACES, float).transpose(1, 0, 2)
        points = np.stack([[corner, corner + b], [corner + a, corner + a + b]])
        return (2.0 * _quads(points) - 1.0) * half_extents(body)
    return body.vertices[body.triangles] - centre(body)


def _ball() -> np.ndarray:
    """Returns triangles of a unit ball."""
    polar, around = np.indices((RINGS + 1, 2 * RINGS + 1)) * (math.pi / RINGS)
    sine = np.sin(polar)
    points = np.stack([sine * np.sin(around), np.cos(polar), sine * np.cos(around)], axis=-1)
    found = _quads(points)
    volume = np.linalg.det(found).sum() / 6.0
    return found * (4.0 / 3.0 * math.pi / volume) ** (1.0 / 3.0)


def _quads(points: np.ndarray) -> np.ndarray:
    """Returns both triangles of each cell of grids of points (n, m, ..., 3), (t, 3, 3)."""
    p, q, r, s = points[:-1, :-1], points[1:, :-1], points[1:, 1:], points[:-1, 1:]
    return np.concatenate([np.stack(t, -2).reshape(-1, 3, 3) for t in ((p, q, r), (p, r, s))])


def split(triangles: np.ndarray) -> np.ndarray:
    """Returns the four parts of each triangle between its corners and the middles of its edges,
    (4 t, 3, 3)."""
    a, b, c = triangles.transpose(1, 0, 2)
    u, v, w = 0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)
    return np.concatenate([np.stack(t, 1) for t in ((a, u, w), (u, b, v), (w, v, c), (u, v, w))])


def faces(body: Body) -> "trimesh.Trimesh":
    """Returns the faces of a body at time zero; the faces of a ball have the ball's area."""
    import trimesh  # 0.4 s to import, and most runs do not need it

    if isinstance(body, Ball):
        mesh = trimesh.creation.icosphere(SUBDIVISIONS, radius=body.radius)
        mesh.apply_scale(np.sqrt(4.0 * np.pi * body.radius**2 / mesh.area))
        return mesh.apply_translation(body.centre)
    if isinstance(body, Block):
        return trimesh.creation.box(bounds=np.array([body.lo, body.hi]))
    return trimesh.Trimesh(body.vertices, body.triangles, process=False)


def samples(body: Body, edge: float, most: int) -> tuple[np.ndarray, np.ndarray]:
    """Returns points (n, 3) [m] on the faces of a body relative to its centre, about `edge` [m]
    apart or less and at most `most`, and the area vectors (n, 3) [m^2] around them, towards the
    water."""
    if isinstance(body, Ball):
        area = 4.0 * np.pi * body.radius**2
        n = int(np.clip(area / edge**2, 12, most))
        y = 1.0 - 2.0 * (np.arange(n) + 0.5) / n
        turn, ring = np.pi * (3.0 - 5.0**0.5) * np.arange(n), np.sqrt(1.0 - y**2)
        normals = np.column_stack([ring * np.cos(turn), y, ring * np.sin(turn)])
        return body.radius * normals, area / n * normals
    found = triangles_of(body)
    while 4 * len(found) <= most and _longest_edge(found) > edge:
        found = split(found)
    inward = isinstance(body, Solid) and body.container
    ab, ac = found[:, 1] - found[:, 0], found[:, 2] - found[:, 0]
    areas = (-0.5 if inward else 0.5) * np.cross(ab, ac)
    return _merged(found.mean(axis=1), areas, MERGED * edge, most)


def _merged(
    points: np.ndarray, areas: np.ndarray, edge: float, most: int
) -> tuple[np.ndarray, np.ndarray]:
    """Merges the samples in each cubic cell of `edge` [m] that face the same of the six directions
    of the axes: at their mean position, with the sum of their area vectors. The cells are enlarged
    until there are at most `most` samples, of which at least 48 must be allowed."""
    axis, size = np.abs(areas).argmax(axis=1), np.linalg.norm(areas, axis=1)
    ahead = areas[np.arange(len(areas)), axis] > 0.0
    cells = np.column_stack([np.floor(points / edge), axis, ahead])
    group = np.unique(cells, axis=0, return_inverse=True)[1].ravel()
    if group.max() >= most:
        return _merged(points, areas, 2.0 * edge, most)
    weights = [size, *(size * points.T), *areas.T]
    total, *sums = (np.bincount(group, weight) for weight in weights)
    total = np.maximum(total, np.finfo(float).tiny)
    return np.column_stack(sums[:3]) / total[:, None], np.column_stack(sums[3:])


def _longest_edge(triangles: np.ndarray) -> float:
    """Returns the length of the longest edge of triangles (t, 3, 3)."""
    return float(np.linalg.norm(triangles - np.roll(triangles, 1, axis=1), axis=-1).max())
