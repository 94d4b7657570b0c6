import pytest
from surface_kit import Cubes, Water, make_water

from msph.surface.lattice import Lattice


@pytest.fixture(scope="session")
def cubes() -> Cubes:
    """Unit spacing, centred on the origin."""
    return Cubes(Lattice.uniform((42, 42, 42), origin=(-20.5, -20.5, -20.5)))


@pytest.fixture(scope="session")
def oblong_cubes() -> Cubes:
    """Spacing and extent differ between the axes; no extent is a multiple of the block."""
    return Cubes(Lattice.uniform((31, 22, 45), (0.1, 0.17, 0.06), (-1.5, -1.8, -1.3)))


@pytest.fixture(scope="session")
def water() -> Water:
    return make_water()


@pytest.fixture(scope="session")
def smooth_water() -> Water:
    return make_water(smoothing=1.4)
