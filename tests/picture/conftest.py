import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from picture_kit import BOX, HEIGHT, WIDTH, Mesh

from msph.picture.picture import Picture


@pytest.fixture(scope="session")
def mesh(taichi_runtime):
    return Mesh()


@pytest.fixture(scope="session")
def picture(mesh):
    """Returns the picture that the tests share, since each further instance would compile all
    kernels again."""
    picture = Picture(mesh)
    picture.load(WIDTH, HEIGHT, BOX)
    return picture
