"""Sampled fields of a closed mesh: its signed distance, and its share for each layer's kernel."""

from functools import partial
from weakref import WeakKeyDictionary

import numpy as np
import taichi as ti

from msph.fluid.boundary.rigid_bodies import Body, Solid, centre
from msph.fluid.boundary.sampled_fields import SampleLattice
from msph.fluid.boundary.signed_distance import signed_distance
from msph.fluid.boundary.volume_map import kernel_share
from msph.fluid.boundary.wall_integrals import wall_support
from msph.fluid.particles.layers import LayerSpec
from msph.kept_arrays import kept

# Cell of the lattices in supports: keeps shares accurate to 0.001.
CELL = 0.2


def lattices(body: Solid, specs: list[LayerSpec]) -> list[SampleLattice]:
    """Returns the lattices of a mesh's distance and of its share for each layer, in its frame."""
    lo, hi = (b - centre(body) for b in body.bounds)
    supports = [s.support for s in specs]
    distance = SampleLattice.covering(lo, hi, max(supports), CELL * min(supports))
    return [distance, *(SampleLattice.covering(lo, hi, h, CELL * h) for h in supports)]


def sample_count(bodies: list[Body], specs: list[LayerSpec]) -> int:
    """Returns the number of f32 values of all bodies' samples."""
    solids = [b for b in bodies if isinstance(b, Solid)]
    return sum(lattice.nodes for b in solids for lattice in lattices(b, specs))


# Samples of meshes in use by their layers: bodies are loaded again when one is added, and when
# simulations use fields in turn.
_known: "WeakKeyDictionary[Solid, dict[tuple[LayerSpec, ...], list[np.ndarray]]]" = (
    WeakKeyDictionary()
)


def sample(body: Solid, own: list[SampleLattice], specs: list[LayerSpec]) -> list[np.ndarray]:
    """Returns a mesh's distances [m] and its shares' B-spline coefficients (-), by lattice."""
    known, key = _known.setdefault(body, {}), tuple(specs)
    if key not in known:
        # Sums of several threads have other rounding errors than those of one.
        how = "samples", str(ti.cfg.arch), ti.cfg.cpu_max_num_threads
        given = *how, body.vertices, body.triangles, centre(body), own, specs
        known[key] = kept(partial(_sample, body, own, specs), *given)
    return known[key]


def _sample(body: Solid, own: list[SampleLattice], specs: list[LayerSpec]) -> list[np.ndarray]:
    # Imported here: only needed for meshes.
    from scipy.ndimage import spline_filter

    vertices = body.vertices - centre(body)
    values = [signed_distance(vertices[body.triangles], own[0], max(s.support for s in specs))]
    for spec, lattice in zip(specs, own[1:], strict=True):
        share = kernel_share(vertices, body.triangles, lattice, wall_support(spec))
        values.append(spline_filter(share, order=3, output=np.float32, mode="mirror"))
    return values
