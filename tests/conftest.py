import json
import math
import os

import pytest

from msph import user_cache
from msph.device import start
from tests.durations import DURATIONS


@pytest.fixture(scope="session", autouse=True)
def taichi_runtime():
    """Starts one Taichi runtime for all tests, because every ti.init would recompile all kernels.
    Each process has one thread, because two processes run the tests in parallel.

    Most kernels run for a short time, so Taichi's optimization passes over their intermediate code,
    a fifth of the suite's time, are omitted; `make test-plain` compiles the simulation as users
    have it. A GPU is used even if it fails the self-test, so that tests show which results are
    wrong.
    """
    if not os.environ.get("MSPH_PLAIN_TAICHI"):
        os.environ.setdefault("TI_ADVANCED_OPTIMIZATION", "0")
    start(os.environ.get("TI_ARCH", "cpu"), threads=1, tested=True)
    allocate_first_world()


def allocate_first_world():
    """Allocates the first world before all other fields, so that each process finds the kernels
    that earlier processes compiled: Taichi's cache on disk identifies fields by the order of their
    allocation."""
    from msph.fluid import world
    from msph.fluid.methods import METHODS
    from msph.fluid.room import FIRST
    from msph.picture.picture import picture_of
    from msph.picture.room import PictureRoom
    from msph.state import state_of
    from msph.surface import SurfaceRoom

    first = world.World(FIRST)
    for method in METHODS.values():
        first.build_once(world._solver, method)
    first.build_once(state_of).build_once(picture_of, SurfaceRoom(), PictureRoom())
    world.give_back(first)


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """Returns the file of the user's cache, in a folder that does not exist yet."""
    monkeypatch.setattr(user_cache, "file", lambda: tmp_path / "cache" / "measured.json")
    return user_cache.file()


def pytest_collection_modifyitems(items):
    """Files that take longest start first, so that the two processes that share the files end at
    nearly the same time; new files before all others."""
    seconds = json.loads(DURATIONS.read_text())
    items.sort(key=lambda item: -seconds.get(item.path.name, math.inf))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_teardown(item):
    """Reports the CPU time [s] since the last test ended, of this process and of those it waited
    for. Unlike elapsed time it hardly depends on what else the machine does."""
    yield
    before = item.session.__dict__.get("cpu_time", 0.0)
    item.session.cpu_time = sum(os.times()[:4])
    item.user_properties.append(("cpu", f"{item.session.cpu_time - before:.2f}"))
