"""Boundary without a simulation, for tests of bodies without water."""

import numpy as np

from msph.fluid.boundary.boundary import Boundary
from msph.fluid.boundary.rigid_bodies import Solid
from msph.fluid.boundary.walls import wall_constants
from msph.fluid.constants import Constants
from msph.fluid.particles.layers import Layers
from msph.fluid.room import FIRST


def solid(mesh, shift=(0.0, 0.0, 0.0), **options):
    """Returns the body of a mesh of trimesh, moved by a shift [m]."""
    return Solid(np.array(mesh.vertices) + shift, np.array(mesh.faces), **options)


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
