"""Colours of bodies with several materials, on a lattice around each body.

Triangles of the eye's rays and hits of marched rays look up the same lattice by their place, so
that a body has one colour however it is seen. A node has the mean colour of the surface in the
cells around it, so borders between colours are a cell wide.
"""

import numpy as np
import taichi as ti

from msph.device_table import DeviceTable, f32, i32
from msph.fluid.boundary.rigid_bodies import Body, centre
from msph.fluid.room import MAX_BODIES
from msph.launches import data_oriented
from msph.picture.pixels import colour_of, words

vec3, ivec3 = ti.math.vec3, ti.math.ivec3

# Nodes of all lattices: a body in a cube has 96 along an edge, eight bodies have 48 each.
ROOM = 96**3


@data_oriented
class BodyPaint:
    """Albedos of the bodies that have a paint. lattices (bodies): the first entry of nodes, -1
    without a paint; nodes along the axes; place of the first node [m] in the frame of the body;
    edge of a cell [m]. nodes: albedos as words."""

    def __init__(self):
        self.lattices = DeviceTable((MAX_BODIES,), first=i32, dims=ivec3, low=vec3, cell=f32)
        self.nodes = DeviceTable((ROOM,), word=i32)

    def load(self, bodies: list[Body]) -> None:
        """Loads the paints of the bodies."""
        paints = [getattr(body, "paint", None) for body in bodies]
        number = sum(paint is not None for paint in paints)
        columns, nodes, first = [], [np.zeros(0, np.int32)], 0
        for body, paint in zip(bodies, paints, strict=True):
            if paint is None:
                columns.append((-1, (2, 2, 2), (0.0, 0.0, 0.0), 1.0))
                continue
            corners = body.vertices[body.triangles] - centre(body)
            low, cell, found = lattice(corners, paint, ROOM // number)
            columns.append((first, found.shape[:3], low, cell))
            nodes.append(words(found).ravel())
            first += len(nodes[-1])
        begins, dims, lows, cells = zip(*columns, strict=True)
        self.lattices.fill(first=begins, dims=dims, low=lows, cell=cells)
        if number:
            self.nodes.fill(word=np.concatenate(nodes)[:, None])

    @ti.func
    def at(self, b, p):
        """Returns the albedo of a painted body b at p [m] in its frame, and True near a border
        between colours."""
        dims, first = self.lattices.dims[b], self.lattices.first[b]
        last = ti.cast(dims, ti.f32) - 1.001
        c = ti.math.clamp((p - self.lattices.low[b]) / self.lattices.cell[b], 0.0, last)
        n = ti.cast(c, ti.i32)
        f, colour, border, own = c - n, vec3(0.0), False, 0
        for q in range(8):
            step = ti.Vector([q & 1, q >> 1 & 1, q >> 2])
            k = n + step
            found = self.nodes.word[first + (k[0] * dims[1] + k[1]) * dims[2] + k[2]]
            share = ti.select(step == 1, f, 1.0 - f)
            colour += share[0] * share[1] * share[2] * colour_of(found)
            own = ti.select(q == 0, found, own)
            border = border or found != own
        return colour, border


def lattice(
    corners: np.ndarray, paint: np.ndarray, room: int
) -> tuple[np.ndarray, float, np.ndarray]:
    """Returns the first node [m], the edge of a cell [m] and the albedos (nx, ny, nz, 3) of a
    lattice of at most `room` nodes around triangles (t, 3, 3) with the albedos `paint` (t, 3)."""
    points = corners.reshape(-1, 3)
    low, extents = points.min(axis=0), np.ptp(points, axis=0)
    # The nodes of a lattice of cubic cells, without those at its ends, fill a box of the extents.
    cell = max(float(np.cbrt(np.prod(extents) / room)), float(extents.max()) / 100.0)
    while np.prod(dims := np.ceil(extents / cell).astype(int) + 1) > room:
        cell *= 1.05
    # Triangles are divided until their middles lie in all cells that the surface crosses.
    while (long := np.ptp(corners, axis=1).max(axis=1) > 0.5 * cell).any():
        a, b, c = corners[long].transpose(1, 0, 2)
        ab, bc, ca = 0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)
        parts = [np.stack(t, 1) for t in ((a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca))]
        corners = np.concatenate([corners[~long], *parts])
        paint = np.concatenate([paint[~long], *[paint[long]] * 4])
    area = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    at = np.clip(((corners.mean(axis=1) - low) / cell).astype(int), 0, dims - 2)
    total, weight = np.zeros((np.prod(dims), 3)), np.zeros(np.prod(dims))
    for q in np.ndindex(2, 2, 2):
        node = np.ravel_multi_index((at + q).T, dims)
        weight += np.bincount(node, area, len(weight))
        for k in range(3):
            total[:, k] += np.bincount(node, area * paint[:, k], len(weight))
    found = total / np.maximum(weight, np.finfo(float).tiny)[:, None]
    found[weight == 0.0] = np.average(paint, axis=0, weights=area)
    return low, cell, found.reshape(*dims, 3)
