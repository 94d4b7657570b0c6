"""Boundary without a simulation, for tests of bodies without water."""

from msph.fluid.boundary.boundary import Boundary
from msph.fluid.boundary.walls import wall_constants
from msph.fluid.constants import Constants
from msph.fluid.particles.layers import Layers
from msph.fluid.room import FIRST

_built: list[Boundary] = []


def boundary_of(size, specs, bodies=()):
    """Returns the boundary that all these tests share, loaded with `bodies` in a box of `size`."""
    if not _built:
        _built.append(Boundary(FIRST, Constants(), Layers()))
    (boundary,) = _built
    boundary.layers.load(specs, Boundary.layer_rows(specs), {})
    boundary.constants.fill(**wall_constants(size, False))
    boundary.load(size, specs, list(bodies))
    return boundary
