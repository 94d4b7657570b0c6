import os

import pytest

from msph.device import start


@pytest.fixture(scope="session", autouse=True)
def taichi_runtime():
    """One Taichi runtime for all tests: every ti.init would recompile everything. Each process has
    one thread, since two of them run beside each other.

    Most kernels run for moments, so the passes over their intermediate code, a fifth of the suite's
    time, are left out; `make test-plain` compiles the water as users have it.
    """
    if not os.environ.get("MSPH_PLAIN_TAICHI"):
        os.environ.setdefault("TI_ADVANCED_OPTIMIZATION", "0")
    start(os.environ.get("TI_ARCH", "cpu"), threads=1)


# Files that take longest, begun first: two processes that share files then end at nearly one time.
LONGEST = (
    "test_window.py",
    "test_lessons.py",
    "test_cli.py",
    "test_pareto.py",
    "test_stability.py",
    "test_random_scenes.py",
    "test_systems.py",
    "test_world.py",
    "test_projection.py",
)


def pytest_collection_modifyitems(items):
    order = {name: place for place, name in enumerate(LONGEST)}
    items.sort(key=lambda item: order.get(item.path.name, len(LONGEST)))
