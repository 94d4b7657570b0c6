import os

import pytest

from msph.device import start


@pytest.fixture(scope="session", autouse=True)
def taichi_runtime():
    """One Taichi runtime for all tests: every ti.init would recompile everything. Each process has
    one thread, since two of them run beside each other.

    Most kernels run for moments, so the passes over their intermediate code, a fifth of the suite's
    time, are left out; `make test-plain` compiles the water as users have it. A GPU is used even if
    it fails the self-test: tests show what it gets wrong.
    """
    if not os.environ.get("MSPH_PLAIN_TAICHI"):
        os.environ.setdefault("TI_ADVANCED_OPTIMIZATION", "0")
    start(os.environ.get("TI_ARCH", "cpu"), threads=1, tested=True)
