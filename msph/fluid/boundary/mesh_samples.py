"""The sampled fields of a closed mesh: its signed distance, and its share for each layer's h."""

import numpy as np

from msph.fluid.boundary.rigid_bodies import Body, Solid, centre
from msph.fluid.boundary.sampled_fields import SampleLattice
from msph.fluid.boundary.signed_distance import signed_distance
from msph.fluid.boundary.volume_map import kernel_share
from msph.fluid.boundary.wall_integrals import wall_support
from msph.fluid.particles.layers import LayerSpec

# Cell of the lattices in supports: cubic interpolation then keeps shares to half a percent.
CELL = 0.2


def lattices(body: Solid, specs: list[LayerSpec]) -> list[SampleLattice]:
    """Lattices on which a mesh's signed distance (first) and its share for each layer's h are
    sampled, in the body's own frame with its centre as origin."""
    lo, hi = (b - centre(body) for b in body.bounds)
    finest = min(s.support for s in specs)
    supports = [finest, *(s.support for s in specs)]
    return [SampleLattice.round(lo, hi, h, CELL * h) for h in supports]


def numbers_needed(bodies: list[Body], specs: list[LayerSpec]) -> int:
    """f32 numbers that the bodies' samples take."""
    solids = [b for b in bodies if isinstance(b, Solid)]
    return sum(lattice.nodes for b in solids for lattice in lattices(b, specs))


def sample(body: Solid, own: list[SampleLattice], specs: list[LayerSpec]) -> list[np.ndarray]:
    """A mesh's signed distance [m] and its shares (-) at the nodes of its lattices."""
    vertices = body.vertices - centre(body)
    finest = min(s.support for s in specs)
    values = [signed_distance(vertices[body.triangles], own[0], finest)]
    for spec, lattice in zip(specs, own[1:], strict=True):
        values.append(kernel_share(vertices, body.triangles, lattice, wall_support(spec)))
    return values
