"""Bodies as triangles: the visible body of each pixel, its depth, and the entry into a container.

A container shows its inside: the first back face behind the entry. Bodies are cut by the walls of
the box: if the first face behind the near pane is a back face of a body, the ray begins in the
body, and the cut is visible on the pane.
"""

import numpy as np
import taichi as ti

from msph.fluid.boundary.body_faces import split, triangles_of
from msph.fluid.boundary.body_shapes import END
from msph.fluid.boundary.boundary import Boundary
from msph.fluid.boundary.rigid_bodies import Block
from msph.launches import data_oriented, kernel
from msph.picture.rasteriser import BLOCK, FAR, NO_ITEM, Rasteriser
from msph.picture.room import PixelFields
from msph.picture.samples import strips
from msph.picture.shot import ray, slabs

vec3 = ti.math.vec3

# Times that the faces of a block are split, so that threads share its pixels.
SPLITS = 2
# Bits of a key that hold the body, and whether its face is a back face; a body uses the upper bits.
KEY_BITS, CUT = 8, 1
# Kinds of faces: visible from outside; back face of a body; near side of a container.
FACE, REAR, ENTRY = range(3)


@data_oriented
class BodyFaces:
    """Draws the bodies of a boundary at the end of a step. key: by pixel, depth and body of the
    visible face, or NO_ITEM; entry: depth [m] at which the ray enters the container, FAR where it
    misses, 0 where it begins in it."""

    def __init__(self, boundary: Boundary, fields: PixelFields, lens, raster: Rasteriser):
        self.boundary, self.lens, self.raster = boundary, lens, raster
        self.key, self.entry = fields.body, fields.entry
        # Corners [m] in the bodies' frames (t, 9), and bodies (t,).
        self.corners, self.owner = np.zeros((0, 9), np.float32), np.zeros(0, np.int32)

    def load(self) -> None:
        """Loads the boundary's present bodies."""
        parts = [triangles_of(body) for body in self.boundary.bodies]
        for b, body in enumerate(self.boundary.bodies):
            for _ in range(SPLITS if isinstance(body, Block) else 0):
                parts[b] = split(parts[b])
        corners = np.concatenate([np.zeros((0, 3, 3)), *parts])
        self.corners = corners.reshape(-1, 9).astype(np.float32)
        self.owner = np.repeat(np.arange(len(parts), dtype=np.int32), [len(p) for p in parts])

    def draw(self) -> None:
        """Fills the fields in the present view."""
        x, size = self.boundary.corners_at_end(), self.lens.numbers["size"]
        crossing = ((x < 0.0) | (x > size)).any(axis=(1, 2)).astype(np.int32)
        self._draw(self.corners, self.owner, crossing, self.boundary.container is not None)

    @kernel
    def _draw(
        self,
        corners: ti.types.ndarray(dtype=ti.f32, ndim=2),
        owner: ti.types.ndarray(dtype=ti.i32, ndim=1),
        crossing: ti.types.ndarray(dtype=ti.i32, ndim=1),
        contained: ti.i32,
    ):
        """crossing: 1 for bodies that may cross walls of the box."""
        first, last = self.lens.shot[None].first, self.lens.shot[None].last
        strip = self.raster.strip
        ti.loop_config(block_dim=self.raster.block)
        for i, s in ti.ndrange((first.x, last.x), strips(last.y - first.y, strip)):
            low = first.y + s * strip
            for j in range(low, ti.min(low + strip, last.y)):
                self.key[i, j], self.entry[i, j] = NO_ITEM, FAR
        ti.loop_config(block_dim=BLOCK)
        for t in range(owner.shape[0]):
            shot, owner_t = self.lens.shot[None], owner[t]
            a, b, c = self.corners_of(t, corners, owner)
            a, b, c = a - shot.eye, b - shot.eye, c - shot.eye
            side, kind = self.boundary.side[owner_t], FACE
            if side * a.dot((b - a).cross(c - a)) > 0.0:
                kind = ti.select(side < 0.0, ENTRY, REAR)
            if kind != REAR or crossing[owner_t] == 1:
                self.raster.fill(ti.Matrix.rows([a, b, c]), owner_t, kind, self, shot)
        ti.loop_config(block_dim=self.raster.block)
        for i, s in ti.ndrange((first.x, last.x), strips(last.y - first.y, strip)):
            low = first.y + s * strip
            for j in range(low, ti.min(low + strip, last.y)):
                if self.key[i, j] != NO_ITEM:
                    self.check(i, j, contained, self.lens.shot[None])

    @ti.func
    def check(self, i, j, contained, shot: ti.template()):
        """Removes the key of a pixel where no body is visible, and finds rays that begin in the
        container."""
        key = self.key[i, j]
        d, depth = ray(i, j, shot), self.depth_of(key, shot)
        if contained == 1 and depth < self.entry[i, j]:
            self.entry[i, j] = 0.0
        p = shot.eye + d * depth
        shown = (p > -shot.skin).all() and (p < shot.size + shot.skin).all()
        if key & CUT != 0:
            # An outline may show a back face without the front face.
            enter, _ = slabs(shot.eye, d, 0.0, shot.size)
            start = shot.eye + d * ti.max(enter.max(), 0.0)
            shown = self.boundary.distance(self.body(i, j), start, END).x < shot.skin
        if not shown:  # behind a wall
            self.key[i, j] = NO_ITEM

    @ti.func
    def corners_of(self, t, corners: ti.template(), owner: ti.template()):
        """Returns the corners [m] of triangle t in the frame of the box."""
        x, turn = self.boundary.centre[owner[t], END], self.boundary.rotation[owner[t], END]
        a = vec3(corners[t, 0], corners[t, 1], corners[t, 2])
        b = vec3(corners[t, 3], corners[t, 4], corners[t, 5])
        c = vec3(corners[t, 6], corners[t, 7], corners[t, 8])
        return x + turn @ a, x + turn @ b, x + turn @ c

    @ti.func
    def put(self, i, j, w, b, kind, shot: ti.template()):
        """Writes a pixel of body b, 1 / w [m] away."""
        if w > 0.0 and w <= shot.w_near:
            if kind == ENTRY:
                ti.atomic_min(self.entry[i, j], 1.0 / w)
            else:
                p = shot.eye + ray(i, j, shot) / w
                # Behind the near panes; a back face on a pane is in front of it.
                skin = ti.select(kind == REAR, shot.skin, -shot.skin)
                lo = ti.select(shot.eye < 0.0, skin, -FAR)
                hi = ti.select(shot.eye > shot.size, shot.size - skin, FAR)
                if (p > lo).all() and (p < hi).all():
                    item = (b << 1) | ti.select(kind == REAR, CUT, 0)
                    key = self.raster.make_key(w, item, KEY_BITS, shot)
                    if key < self.key[i, j]:
                        ti.atomic_min(self.key[i, j], key)

    @ti.func
    def depth_of(self, key, shot: ti.template()):
        """Returns the depth [m] of a key: 0 of a cut."""
        w = self.raster.inverse_depth(key, KEY_BITS, shot)
        return ti.select(key & CUT != 0, 0.0, 1.0 / w)

    @ti.func
    def depth(self, i, j, shot: ti.template()):
        """Returns the depth [m] of the body at a pixel, FAR without a body, 0 if a pane cuts it."""
        key, found = self.key[i, j], ti.f32(FAR)
        if key != NO_ITEM:
            found = self.depth_of(key, shot)
        return found

    @ti.func
    def body(self, i, j):
        """Returns the body at a pixel, or -1."""
        key = self.key[i, j]
        return ti.select(key == NO_ITEM, -1, (key & ((1 << KEY_BITS) - 1)) >> 1)
