import pytest
import taichi as ti


@pytest.fixture(scope="session", autouse=True)
def taichi_runtime():
    """One Taichi runtime for all tests: every ti.init would recompile everything."""
    ti.init(arch=ti.cpu, log_level=ti.WARN)
