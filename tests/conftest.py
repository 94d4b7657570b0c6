import os

import pytest

from msph.device import start


@pytest.fixture(scope="session", autouse=True)
def taichi_runtime():
    """One Taichi runtime for all tests: every ti.init would recompile everything."""
    start(os.environ.get("TI_ARCH", "cpu"))
