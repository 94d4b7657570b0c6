"""The faces of a body as triangles."""

from typing import TYPE_CHECKING

import numpy as np

from msph.fluid.boundary.rigid_bodies import Ball, Block, Body

if TYPE_CHECKING:
    import trimesh

# Rounds of halving an icosahedron's edges for a ball: 1280 faces. Scaled to the ball's area they
# enclose .15 % less than its volume.
ROUNDS = 3


def faces(body: Body) -> "trimesh.Trimesh":
    """The faces of a body where it stands at time zero; those of a ball have its area in all."""
    import trimesh  # here, since it takes .4 s and most starts do without

    if isinstance(body, Ball):
        mesh = trimesh.creation.icosphere(ROUNDS, radius=body.radius)
        mesh.apply_scale(np.sqrt(4.0 * np.pi * body.radius**2 / mesh.area))
        return mesh.apply_translation(body.centre)
    if isinstance(body, Block):
        return trimesh.creation.box(bounds=np.array([body.lo, body.hi]))
    return trimesh.Trimesh(body.vertices, body.triangles, process=False)
