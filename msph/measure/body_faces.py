"""Triangle meshes of bodies."""

from typing import TYPE_CHECKING

import numpy as np

from msph.fluid.boundary.rigid_bodies import Ball, Block, Body

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
