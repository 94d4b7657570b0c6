"""Parts of an image that change when bodies move, so that only these parts are redrawn.

A body and its shadow lie within the corners of its bounding box swept along the sunlight. The
corners before and after a motion are projected on the host, and mark blocks of COARSE^2 pixels.
"""

import numpy as np
import taichi as ti

from msph.launches import data_oriented, kernel
from msph.picture.room import COARSE, PictureRoom
from msph.picture.samples import SPAN
from msph.picture.shadows import SHARPNESS
from msph.picture.shot import NEAR_PLANE, PARALLEL

# Largest movement [pixels] of a corner that is not visible.
INVISIBLE = 0.05
# Width [pixels] of the margin around a body in which blocks of pixels are uneven.
MARGIN = 2 * SPAN
# Number of parts of a shadow, each of which marks a rectangle.
PARTS = 4


@data_oriented
class MovedBodies:
    """Marks of blocks of pixels. marks (columns, rows): 1 where a moved body or its shadow may be
    visible."""

    def __init__(self, boundary, room: PictureRoom):
        self.boundary = boundary
        self.marks = ti.field(ti.i32, (room.width // COARSE + 1, room.height // COARSE + 1))
        # As last drawn: corners [pixels] (bodies, PARTS + 1, 8, 2), and rectangles.
        self._drawn: tuple[np.ndarray, np.ndarray] | None = None

    def find(self, shot, whole):
        """Marks the blocks to draw in the view of the shot's numbers; whole: all are drawn. Returns
        True if a body moved, or None if all blocks must be drawn."""
        found, before = self._project(shot), self._drawn
        self._drawn = found
        if found is None or before is None or whole:
            return None
        (corners, now), (old_corners, old) = found, before
        moved = np.abs(corners - old_corners).max(axis=(1, 2, 3)) > INVISIBLE
        # Bodies that did not move visibly keep their corners, so that slow movements add up.
        corners[~moved], now[~moved] = old_corners[~moved], old[~moved]
        if moved.any():
            marked = np.zeros(self.marks.shape, np.int32)
            for left, right, low, high in np.concatenate([now[moved], old[moved]]).reshape(-1, 4):
                marked[left:right, low:high] = 1
            self._mark(marked)
        return moved.any()

    @kernel
    def _mark(self, marked: ti.types.ndarray(dtype=ti.i32, ndim=2)):
        for i, j in self.marks:
            self.marks[i, j] = marked[i, j]

    def _project(self, shot):
        """Returns corners, and rectangles (low and high column, low and high row) of blocks of all
        bodies, (bodies, 1 + PARTS, 4), or None if a body reaches behind the eye."""
        x = self.boundary.corners_at_end()[:, None]
        away = -np.where(np.abs(shot["sun"]) < PARALLEL, PARALLEL, shot["sun"])
        # Way of sunlight from each corner until it leaves the box [m], the longest of each body.
        way = ((np.where(away > 0.0, shot["size"], 0.0) - x) / away).min(axis=3)
        way = np.maximum(way.max(axis=2), 0.0) * np.linspace(0.0, 1.0, PARTS + 1)
        x = x + way[:, :, None, None] * away
        c = x - shot["eye"]
        depth = c @ shot["forward"]
        if (depth <= NEAR_PLANE).any():
            return None
        at = np.stack([c @ shot["to_i"], c @ shot["to_j"]], axis=3) / depth[..., None]
        corners = at + shot["centre"]
        # A penumbra is wider than the body by its distance over the sharpness.
        size = np.linalg.norm(x[:, :1, 7] - x[:, :1, 0], axis=2)
        wider = (way + size * (way > 0.0)) / SHARPNESS / (shot["pixel"] * depth.min(axis=2))
        margin = (MARGIN + wider)[..., None]
        low, high = corners.min(axis=2) - margin, corners.max(axis=2) + margin
        # The body itself, and each part of its shadow between two places of the corners.
        low = np.concatenate([low[:, :1], np.minimum(low[:, :-1], low[:, 1:])], axis=1)
        high = np.concatenate([high[:, :1], np.maximum(high[:, :-1], high[:, 1:])], axis=1)
        blocks = np.stack([np.floor(low / COARSE), np.ceil(high / COARSE)], axis=3)
        blocks = np.clip(blocks, 0, max(self.marks.shape)).astype(int)
        return corners, blocks.reshape(len(x), PARTS + 1, 4)
