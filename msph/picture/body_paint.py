"""Colours of bodies with several materials, on a lattice around each body.

Rays of the eye and reflected and refracted rays look up the same lattice, so that a place has the
same colour in all of them. Borders between colours are about a cell wide.
"""

from functools import lru_cache, partial

import numpy as np
import taichi as ti

from msph.device_table import DeviceTable, f32, i32
from msph.fluid.boundary.rigid_bodies import Body, Solid, centre
from msph.fluid.external_forces import cross
from msph.fluid.room import MAX_BODIES
from msph.kept_arrays import kept
from msph.launches import data_oriented
from msph.picture.pixels import colour_of, words

vec3, ivec3 = ti.math.vec3, ti.math.ivec3

# Nodes of all lattices: a body in a cube has 96 along an edge, eight bodies have 48 each.
ROOM = 96**3
# Least edge of a cell, over the longest edge of a body's bounds; growth (-) of cells until all
# nodes fit; longest extent of a part of a triangle, in cells: each crossed cell then has a part.
LEAST_CELL, GROWTH, LONGEST = 0.01, 1.05, 0.5


@data_oriented
class BodyPaint:
    """Albedos of the bodies that have a paint. lattices (bodies): the first entry of nodes, -1
    without a paint; nodes along the axes; place of the first node [m] in the frame of the body;
    edge of a cell [m]. nodes: albedos as words."""

    def __init__(self):
        self.lattices = DeviceTable((MAX_BODIES,), first=i32, dims=ivec3, low=vec3, cell=f32)
        self.nodes = DeviceTable((ROOM,), word=i32)

    def load(self, bodies: list[Body]) -> None:
        """Loads the paints of the bodies, if there are any."""
        if not bodies:
            return
        paints = [getattr(body, "paint", None) for body in bodies]
        number = sum(paint is not None for paint in paints)
        columns, nodes, first = [], [np.zeros(0, np.int32)], 0
        for body, paint in zip(bodies, paints, strict=True):
            if paint is None:
                columns.append((-1, (2, 2, 2), (0.0, 0.0, 0.0), 1.0))
                continue
            low, cell, found = painted(body, ROOM // number)
            columns.append((first, found.shape, low, cell))
            nodes.append(found.ravel())
            first += found.size
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


@lru_cache(MAX_BODIES)
def painted(body: Solid, room: int) -> tuple[np.ndarray, float, np.ndarray]:
    """Returns lattice() of a painted body, in its frame, with albedos as words (nx, ny, nz)."""
    given = body.vertices[body.triangles] - centre(body), body.paint, room
    low, cell, found = kept(partial(_painted, *given), "paint", *given)
    return low, float(cell), found


def _painted(corners: np.ndarray, paint: np.ndarray, room: int) -> list[np.ndarray]:
    """Returns painted() of triangles (t, 3, 3) [m] with albedos (t, 3), as arrays."""
    low, cell, found = lattice(corners, paint, room)
    return [low, np.array(cell), words(found)]


def lattice(
    corners: np.ndarray, paint: np.ndarray, room: int
) -> tuple[np.ndarray, float, np.ndarray]:
    """Returns the first node [m], the edge of a cell [m] and the albedos (nx, ny, nz, 3) of a
    lattice of at most `room` nodes around triangles (t, 3, 3) [m] with the albedos `paint` (t, 3).

    A node has the mean albedo of the surface in the eight cells around the node, and nodes without
    surface the mean albedo of all triangles."""
    low, extents = corners.min(axis=(0, 1)), np.ptp(corners, axis=(0, 1))
    cell = max(float(np.cbrt(np.prod(extents) / room)), float(extents.max()) * LEAST_CELL)
    while np.prod(dims := np.ceil(extents / cell).astype(int) + 1) > room:
        cell *= GROWTH
    # By corner, axis and triangle: sums along long rows are faster.
    whole, tint, done = np.ascontiguousarray(corners.transpose(1, 2, 0)), paint.T, []
    while whole.shape[2]:
        long = np.ptp(whole, axis=0).max(axis=0) > LONGEST * cell
        done.append((whole[:, :, ~long], tint[:, ~long]))
        a, b, c = whole[:, :, long]
        ab, bc, ca = 0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)
        whole = np.stack([[a, b, c, ab], [ab, bc, ca, bc], [ca, ab, bc, ca]])
        whole = whole.transpose(0, 2, 1, 3).reshape(3, 3, -1)
        tint = np.tile(tint[:, long], 4)
    parts, tints = (np.concatenate(each, axis=-1) for each in zip(*done, strict=True))
    a, b, c = parts.transpose(0, 2, 1)
    area = np.linalg.norm(cross(b - a, c - a), axis=1)
    at = np.clip(((parts.mean(axis=0).T - low) / cell).astype(int), 0, dims - 2)
    cells, size = np.ravel_multi_index(at.T, dims), int(np.prod(dims))
    sums = [np.bincount(cells, area * tint, size) for tint in (1.0, *tints)]
    around = np.reshape(sums, (4, *dims))
    for axis in (1, 2, 3):  # the last cells are empty
        around = around + np.roll(around, 1, axis)
    found = around[1:] / np.maximum(around[0], np.finfo(float).tiny)
    found[:, around[0] == 0.0] = (tints @ area / area.sum())[:, None]
    return low, cell, np.moveaxis(found, 0, -1)
