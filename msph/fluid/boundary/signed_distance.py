"""Signed distance of a closed mesh on a lattice, negative inside.

Within a band around the surface the distance is exact to rounding: the distance to the nearest
point of the triangles near a node (Ericson 2005, 5.1.5). Beyond the band it is the distance to the
nearest node in the band and from there to the surface: too long, but enough to push particles out.
The sign follows from the number and direction of the crossings of the surface along z.
"""

import numpy as np
import taichi as ti

from msph.fluid.boundary.sampled_fields import SampleLattice

vec2, vec3 = ti.math.vec2, ti.math.vec3

FAR = 1e9  # distance not yet known [m]


def signed_distance(corners: np.ndarray, lattice: SampleLattice, band: float) -> np.ndarray:
    """Returns the signed distance [m] at the nodes, (nx, ny, nz) f32. corners: (t, 3, 3) [m] of a
    closed mesh, counter-clockwise seen from outside; band [m]."""
    distance = np.full(lattice.shape, FAR, np.float32)
    corners = np.ascontiguousarray(corners, np.float32)
    _measure_in_band(corners, vec3(*lattice.origin), lattice.cell, band, distance)
    distance = _beyond_band(distance, lattice.cell, band)
    return np.where(inside(corners, lattice), -distance, distance)


def _beyond_band(distance: np.ndarray, cell: float, band: float) -> np.ndarray:
    """Returns the distances [m] continued beyond the band, (nx, ny, nz) f32; the band must hold a
    node. cell, band [m]."""
    from scipy.ndimage import distance_transform_edt  # 0.2 s to import, and only meshes need it

    known = distance < band
    away, nearest = distance_transform_edt(~known, cell, return_indices=True)
    return np.where(known, distance, away + distance[tuple(nearest)]).astype(np.float32)


def inside(corners: np.ndarray, lattice: SampleLattice) -> np.ndarray:
    """Returns whether each node is inside the mesh, (nx, ny, nz) bool."""
    nx, ny, nz = lattice.shape
    crossings = np.zeros((nx, ny, nz + 1), np.int32)
    corners = np.ascontiguousarray(corners, np.float32)
    _count_crossings(corners, vec3(*lattice.origin), lattice.cell, crossings)
    return np.cumsum(crossings, axis=2)[:, :, :nz] > 0


@ti.func
def nodes_near(a, b, c, margin, origin, cell, shape):
    """Returns the first and the last node, as rows, within `margin` [m] of a triangle's bounds."""
    lo = ti.ceil((ti.min(a, b, c) - margin - origin) / cell, ti.i32)
    hi = ti.floor((ti.max(a, b, c) + margin - origin) / cell, ti.i32)
    return ti.Matrix.rows([ti.max(lo, 0), ti.min(hi, shape - 1)])


@ti.func
def nearest_of_triangle(p, a, b, c):
    """Returns the point of a triangle nearest to p."""
    ab, ac, ap = b - a, c - a, p - a
    d1, d2 = ab.dot(ap), ac.dot(ap)
    bp, cp = p - b, p - c
    d3, d4 = ab.dot(bp), ac.dot(bp)
    d5, d6 = ab.dot(cp), ac.dot(cp)
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    q = a
    if d1 <= 0.0 and d2 <= 0.0:
        q = a
    elif d3 >= 0.0 and d4 <= d3:
        q = b
    elif d6 >= 0.0 and d5 <= d6:
        q = c
    elif vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        q = a + d1 / (d1 - d3) * ab
    elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        q = a + d2 / (d2 - d6) * ac
    elif va <= 0.0 and d4 >= d3 and d5 >= d6:
        q = b + (d4 - d3) / (d4 - d3 + d5 - d6) * (c - b)
    else:
        q = a + (vb * ab + vc * ac) / (va + vb + vc)
    return q


@ti.kernel
def _measure_in_band(
    corners: ti.types.ndarray(dtype=ti.f32, ndim=3),
    origin: vec3,
    cell: ti.f32,
    band: ti.f32,
    distance: ti.types.ndarray(dtype=ti.f32, ndim=3),
):
    """Computes the distance to the nearest triangle at the nodes within `band` of a triangle."""
    shape = ti.Vector([distance.shape[0], distance.shape[1], distance.shape[2]])
    for t in range(corners.shape[0]):
        a, b, c = corner(corners, t, 0), corner(corners, t, 1), corner(corners, t, 2)
        near = nodes_near(a, b, c, band, origin, cell, shape)
        for i in range(near[0, 0], near[1, 0] + 1):
            for j in range(near[0, 1], near[1, 1] + 1):
                for k in range(near[0, 2], near[1, 2] + 1):
                    x = origin + cell * vec3(i, j, k)
                    d = (x - nearest_of_triangle(x, a, b, c)).norm()
                    if d < band:
                        ti.atomic_min(distance[i, j, k], d)


@ti.kernel
def _count_crossings(
    corners: ti.types.ndarray(dtype=ti.f32, ndim=3),
    origin: vec3,
    cell: ti.f32,
    crossings: ti.types.ndarray(dtype=ti.i32, ndim=3),
):
    """Counts the triangles that a column of nodes crosses along z, +1 where it enters the mesh and
    -1 where it leaves, at the first node beyond the crossing."""
    shape = ti.Vector([crossings.shape[0], crossings.shape[1], crossings.shape[2]])
    for t in range(corners.shape[0]):
        a, b, c = corner(corners, t, 0), corner(corners, t, 1), corner(corners, t, 2)
        n = (b - a).cross(c - a)
        up = n.z > 0.0
        near = nodes_near(a, b, c, 0.0, origin, cell, shape)
        for i in range(near[0, 0], near[1, 0] + 1):
            for j in range(near[0, 1], near[1, 1] + 1):
                p = origin.xy + cell * vec2(i, j)
                ab, bc, ca = is_left(a, b, p) == up, is_left(b, c, p) == up, is_left(c, a, p) == up
                if n.z != 0.0 and ab and bc and ca:
                    z = a.z - (n.x * (p.x - a.x) + n.y * (p.y - a.y)) / n.z
                    z = ti.math.clamp(z, ti.min(a.z, b.z, c.z), ti.max(a.z, b.z, c.z))
                    k = ti.math.clamp(ti.ceil((z - origin.z) / cell, ti.i32), 0, shape[2] - 1)
                    ti.atomic_add(crossings[i, j, k], ti.select(up, -1, 1))


@ti.func
def corner(corners: ti.template(), t, k):
    """Returns corner k of triangle t [m]."""
    return vec3(corners[t, k, 0], corners[t, k, 1], corners[t, k, 2])


@ti.func
def is_left(p, q, x):
    """Returns whether x is left of the edge from p to q, seen along -z. The result for q to p is
    always the opposite, so that exactly one of two triangles contains a point on their edge."""
    forward = p.x < q.x or (p.x == q.x and p.y < q.y)
    s, e = p.xy, q.xy
    if not forward:
        s, e = q.xy, p.xy
    return ((e - s).cross(x - s) >= 0.0) == forward
