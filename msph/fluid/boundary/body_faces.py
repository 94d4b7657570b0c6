"""Triangle meshes of bodies."""

from typing import TYPE_CHECKING

import numpy as np

from msph.fluid.boundary.rigid_bodies import Ball, Block, Body, Solid, centre

if TYPE_CHECKING:
    import trimesh

# Subdivisions of an icosahedron for a ball: 1280 faces, which enclose 0.15 % less than the ball's
# volume when scaled to its area.
SUBDIVISIONS = 3


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
    apart and at most `most`, and the area vectors (n, 3) [m^2] around them, towards the water."""
    if isinstance(body, Ball):
        area = 4.0 * np.pi * body.radius**2
        n = int(np.clip(area / edge**2, 12, most))
        y = 1.0 - 2.0 * (np.arange(n) + 0.5) / n
        turn, ring = np.pi * (3.0 - 5.0**0.5) * np.arange(n), np.sqrt(1.0 - y**2)
        normals = np.column_stack([ring * np.cos(turn), y, ring * np.sin(turn)])
        return body.radius * normals, area / n * normals
    mesh = faces(body)
    while mesh.edges_unique_length.max() > edge and 4 * len(mesh.faces) <= most:
        mesh = mesh.subdivide()
    inward = isinstance(body, Solid) and body.container
    sign = -1.0 if inward else 1.0
    areas = sign * mesh.face_normals * mesh.area_faces[:, None]
    return mesh.triangles_center - centre(body), areas
