import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

import taichi as ti
from picture_kit import BOX, HEIGHT, LAYER, WIDTH, Mesh, NoDrops

from msph.picture.picture import Picture
from tests.boundary_kit import boundary_of


@pytest.fixture(scope="session")
def mesh(taichi_runtime):
    return Mesh()


@pytest.fixture(scope="session")
def built(mesh):
    """Returns the only picture of a process, since each further one would compile all kernels
    again."""
    return Picture(mesh, boundary_of(BOX, [LAYER]), thin=ti.data_oriented(NoDrops)())


@pytest.fixture
def picture(built):
    """Returns the picture that the tests share, without bodies; tests set bodies by `boundary_of`,
    and may load other boxes and looks."""
    boundary_of(BOX, [LAYER])
    built.load(WIDTH, HEIGHT, BOX)
    return built
