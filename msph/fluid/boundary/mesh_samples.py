"""Sampled fields of a closed mesh: its signed distance, and its share for each layer's kernel."""

import numpy as np

from msph.fluid.boundary.rigid_bodies import Body, Solid, centre
from msph.fluid.boundary.sampled_fields import SampleLattice
from msph.fluid.boundary.signed_distance import signed_distance
from msph.fluid.boundary.volume_map import kernel_share
from msph.fluid.boundary.wall_integrals import swelling, wall_support
from msph.fluid.particles.layers import LayerSpec
from msph.fluid.small_numbers import MIN_DIVISOR

# Cell of the lattices in supports: keeps shares accurate to 0.001.
CELL = 0.2
# Least eigenvalue, over the largest, of a vertex's normals that counts as a direction: otherwise
# vertices of flat but rough faces would move far along them.
FLAT = 0.05


def lattices(body: Solid, specs: list[LayerSpec]) -> list[SampleLattice]:
    """Returns the lattices of a mesh's distance and of its share for each layer, in its frame."""
    lo, hi = (b - centre(body) for b in body.bounds)
    finest = min(s.support for s in specs)
    supports = [finest, *(s.support for s in specs)]
    return [SampleLattice.covering(lo, hi, h, CELL * h) for h in supports]


def sample_count(bodies: list[Body], specs: list[LayerSpec]) -> int:
    """Returns the number of f32 values of all bodies' samples."""
    solids = [b for b in bodies if isinstance(b, Solid)]
    return sum(lattice.nodes for b in solids for lattice in lattices(b, specs))


def sample(body: Solid, own: list[SampleLattice], specs: list[LayerSpec]) -> list[np.ndarray]:
    """Returns a mesh's distances [m] and its shares' B-spline coefficients (-), by lattice."""
    # Imported here: only needed for meshes.
    from scipy.ndimage import spline_filter

    vertices = body.vertices - centre(body)
    finest = min(s.support for s in specs)
    values = [signed_distance(vertices[body.triangles], own[0], finest)]
    for spec, lattice in zip(specs, own[1:], strict=True):
        out = swelling(spec) * (-1.0 if body.container else 1.0)
        moved = vertices + out * outward(vertices, body.triangles)
        share = kernel_share(moved, body.triangles, lattice, wall_support(spec))
        values.append(spline_filter(share, order=3, output=np.float32, mode="mirror"))
    return values


def outward(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Returns displacements (v, 3) of the vertices (-) that move every face outwards by 1: n.u = 1
    for the normals n of a vertex's triangles, least squares weighted by area, of minimal length."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    area = np.linalg.norm(normals, axis=1)
    n = normals / np.maximum(area, MIN_DIVISOR)[:, None]
    squares, sums = np.zeros((len(vertices), 3, 3)), np.zeros((len(vertices), 3))
    for k in range(3):
        np.add.at(squares, triangles[:, k], area[:, None, None] * n[:, :, None] * n[:, None, :])
        np.add.at(sums, triangles[:, k], area[:, None] * n)
    inverse = np.linalg.pinv(squares, rcond=FLAT, hermitian=True)
    return np.einsum("vij,vj->vi", inverse, sums)
