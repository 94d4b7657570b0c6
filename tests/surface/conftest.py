from collections.abc import Iterator

import numpy as np
import pytest
import trimesh
from surface_kit import CELL, SIZE, Cubes, Water, uniform

from msph.fluid.boundary.rigid_bodies import Ball, Block
from msph.launches import watch_compiling
from msph.surface import SurfaceRoom
from msph.surface.marching_cubes import MarchingCubes
from tests.boundary_kit import solid


@pytest.fixture(scope="session")
def marching_cubes() -> MarchingCubes:
    """Returns the marching cubes that all lattices share in turn."""
    return MarchingCubes(SurfaceRoom(vertices=60_000, triangles=120_000))


@pytest.fixture
def cubes(marching_cubes) -> Cubes:
    """Returns marching cubes on a lattice of unit spacing, centred on the origin."""
    return Cubes(uniform((42, 42, 42), origin=(-20.5, -20.5, -20.5)), marching_cubes)


@pytest.fixture
def oblong_cubes(marching_cubes) -> Cubes:
    """Returns marching cubes on a lattice whose spacing and extent differ between the axes; no
    extent is a multiple of a word of signs."""
    lattice = uniform((31, 22, 45), (0.1, 0.17, 0.06), (-1.5, -1.8, -1.3))
    return Cubes(lattice, marching_cubes)


# Each test file returns its fields to the stock, so that the next file compiles nothing.
@pytest.fixture(scope="module")
def water() -> Iterator[Water]:
    water = Water()
    yield water
    water.simulation.close()


@pytest.fixture
def smooth_water(water) -> Iterator[Water]:
    water.surface.load(SIZE, CELL, smoothing=1.4)
    yield water
    water.surface.load(SIZE, CELL)


@pytest.fixture(scope="module")
def held_water() -> Iterator[Water]:
    """Yields water in a mesh container of almost the box's size, with a ball and a block in it."""
    egg = trimesh.creation.icosphere(subdivisions=3)
    egg.apply_scale(0.48 * np.array(SIZE))
    container = solid(egg, 0.5 * np.array(SIZE), container=True)
    ball = Ball(np.array((0.22, 0.2, 0.2)), 0.07)
    block = Block(np.array((0.36, 0.05, 0.14)), np.array((0.44, 0.4, 0.24)))
    water = Water(bodies=[container, ball, block])
    yield water
    water.simulation.close()


@pytest.fixture
def compiled() -> Iterator[list[str]]:
    """Yields the names of the kernels that the test has compiled so far."""
    names: list[str] = []
    with watch_compiling(names.append):
        yield names
