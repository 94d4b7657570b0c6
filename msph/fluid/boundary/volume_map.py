"""Share of the kernel's integral inside a closed mesh, at the nodes of a lattice.

By Gauss's theorem the Wendland C2 kernel's integral over a body is a sum over its triangles: with
m(q) the share of the kernel within q h of its centre, 14 q^3 - 84 q^5 + 140 q^6 - 90 q^7 + 21 q^8,
      share = sum of z/(4 pi) * integral of m(r)/r^3 over the triangle,
z the distance to its plane, positive from inside. In the plane the radial integral is closed, with
D(q) = 7 q^2 - 21 q^4 + 28 q^5 - 15 q^6 + 3 q^7 (3 - 1/q beyond q = 1), which leaves one integral
along each edge. A triangle out of the kernel's reach contributes its solid angle only, and the sum
of all solid angles is 1 inside, 0 outside; so each triangle within reach adds the difference.
Edges, corners and curvature are exact for every h.
"""

import math

import numpy as np
import taichi as ti

from msph.fluid.boundary.sampled_fields import SampleLattice
from msph.fluid.boundary.signed_distance import corner, inside, nearest_of_triangle, nodes_near

vec3 = ti.math.vec3

# Number of Gauss-Legendre points on an edge: FEW up to a length of SHORT h, MANY up to h. FEW
# change no share of duck and bowl by more than 7e-6, and sampling takes 0.6 of the time.
FEW, MANY, SHORT = 2, 6, 0.3
_rules = [np.polynomial.legendre.leggauss(points) for points in (FEW, MANY)]
_nodes, _weights = (np.concatenate(parts) for parts in zip(*_rules, strict=True))
# Points and weights on 0..1: FEW, then MANY.
ABSCISSAE, WEIGHTS = ti.Vector((0.5 + 0.5 * _nodes).tolist()), ti.Vector((0.5 * _weights).tolist())
# (rho/h)^2 below which the difference quotient of D is replaced by the derivative (rounding).
NEAR = 0.01


def kernel_share(
    vertices: np.ndarray, triangles: np.ndarray, lattice: SampleLattice, h: float
) -> np.ndarray:
    """Returns the share (-) at the nodes, (nx, ny, nz) f32. vertices (v, 3) [m], triangles (t, 3)
    counter-clockwise seen from outside; h [m]."""
    # Imported here: only needed for meshes, and takes 0.3 s.
    from trimesh.remesh import subdivide_to_size

    corners = vertices[triangles]
    share = inside(corners, lattice).astype(np.float32)
    fine_vertices, fine_triangles = subdivide_to_size(vertices, triangles, h, max_iter=40)
    fine = np.ascontiguousarray(fine_vertices[fine_triangles], np.float32)
    _add(fine, vec3(*lattice.origin), lattice.cell, h, share)
    return np.clip(share, 0.0, 1.0)


@ti.kernel
def _add(
    corners: ti.types.ndarray(dtype=ti.f32, ndim=3),
    origin: vec3,
    cell: ti.f32,
    h: ti.f32,
    share: ti.types.ndarray(dtype=ti.f32, ndim=3),
):
    """Adds every triangle's part to the nodes within h of it."""
    shape = ti.Vector([share.shape[0], share.shape[1], share.shape[2]])
    for t in range(corners.shape[0]):
        a, b, c = corner(corners, t, 0), corner(corners, t, 1), corner(corners, t, 2)
        near = nodes_near(a, b, c, h, origin, cell, shape)
        middle = (a + b + c) / 3.0
        size = ti.max((a - middle).norm(), (b - middle).norm(), (c - middle).norm())
        for i in range(near[0, 0], near[1, 0] + 1):
            for j in range(near[0, 1], near[1, 1] + 1):
                for k in range(near[0, 2], near[1, 2] + 1):
                    x = origin + cell * vec3(i, j, k)
                    distance = (x - middle).norm()
                    if abs(distance - h) < size:
                        distance = (x - nearest_of_triangle(x, a, b, c)).norm()
                    if distance < h:
                        part = triangle_part((a - x) / h, (b - x) / h, (c - x) / h)
                        ti.atomic_add(share[i, j, k], part)


@ti.func
def triangle_part(a, b, c):
    """Returns (z sum over edges of the integral of (D(r) - D(z)) d theta - solid angle)/(4 pi).

    Corners relative to the kernel's centre, in h.
    """
    n = (b - a).cross(c - a).normalized()
    z = a.dot(n)
    foot = z * n
    total = 0.0
    edges = ti.Matrix.rows([a, b, c, a])
    for e in ti.static(range(3)):
        p = vec3(edges[e, 0], edges[e, 1], edges[e, 2])
        way = vec3(edges[e + 1, 0], edges[e + 1, 1], edges[e + 1, 2]) - p
        # Twice the area between edge and foot: d theta = area/rho^2 d(fraction of the edge).
        area = n.dot((p - foot).cross(way))
        first, last = 0, FEW
        if way.norm_sqr() > SHORT * SHORT:
            first, last = FEW, FEW + MANY
        for g in range(first, last):
            y = p + ABSCISSAE[g] * way
            total += WEIGHTS[g] * area * quotient((y - foot).norm_sqr(), z * z)
    la, lb, lc = a.norm(), b.norm(), c.norm()
    angle = 2.0 * ti.atan2(
        a.dot(b.cross(c)), la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb
    )
    return (z * total - angle) / (4.0 * math.pi)


@ti.func
def quotient(rho2, z2):
    """Returns (D(r) - D(z))/rho^2 with r^2 = z^2 + rho^2."""
    q = ti.sqrt(z2 + 0.5 * rho2)
    found = 7.0 + q * q * (-42.0 + q * (70.0 + q * (-45.0 + 10.5 * q)))
    if rho2 > NEAR:
        found = (radial(ti.sqrt(z2 + rho2)) - radial(ti.sqrt(z2))) / rho2
    elif q > 1.0:
        found = 0.5 / q**3
    return found


@ti.func
def radial(q):
    """Returns D(q)."""
    inner = q * q * (7.0 + q * q * (-21.0 + q * (28.0 + q * (-15.0 + 3.0 * q))))
    return ti.select(q < 1.0, inner, 3.0 - 1.0 / ti.max(q, 1e-6))
