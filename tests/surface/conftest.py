import numpy as np
import pytest
import trimesh
from surface_kit import SIZE, Cubes, Water, make_water

from msph.fluid.boundary.rigid_bodies import Ball, Block, Solid
from msph.surface.lattice import Lattice


@pytest.fixture(scope="session")
def cubes() -> Cubes:
    """Unit spacing, centred on the origin."""
    return Cubes(Lattice.uniform((42, 42, 42), origin=(-20.5, -20.5, -20.5)))


@pytest.fixture(scope="session")
def oblong_cubes() -> Cubes:
    """Spacing and extent differ between the axes; no extent is a multiple of a word of signs."""
    return Cubes(Lattice.uniform((31, 22, 45), (0.1, 0.17, 0.06), (-1.5, -1.8, -1.3)))


@pytest.fixture(scope="session")
def water() -> Water:
    return make_water()


@pytest.fixture(scope="session")
def smooth_water() -> Water:
    return make_water(smoothing=1.4)


@pytest.fixture(scope="session")
def held_water() -> Water:
    """A mesh container of almost the box's size, with a ball and a block in it."""
    egg = trimesh.creation.icosphere(subdivisions=3)
    container = Solid(
        np.array(SIZE) * (0.5 + 0.48 * np.array(egg.vertices)), np.array(egg.faces), container=True
    )
    ball = Ball(np.array((0.22, 0.2, 0.2)), 0.07)
    block = Block(np.array((0.36, 0.05, 0.14)), np.array((0.44, 0.4, 0.24)))
    return make_water(bodies=[container, ball, block])
