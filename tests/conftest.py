import os

import pytest

from msph.device import start


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
    from msph.surface import SurfaceRoom

    first = world.World(FIRST)
    for method in METHODS.values():
        first.build_once(world._solver, method)
    first.build_once(picture_of, SurfaceRoom(), PictureRoom())
    world.give_back(first)


# Files that take longest. They start first, so that the two processes that share the files end at
# nearly the same time.
LONGEST = (
    "test_shipped_scenes.py",
    "test_lessons.py",
    "test_window.py",
    "test_window_ends.py",
    "test_recording.py",
    "test_random_input.py",
    "test_player_tools.py",
    "test_player.py",
    "test_player_panels.py",
    "test_player_row.py",
    "test_recorder.py",
    "test_systems.py",
    "test_pareto.py",
    "test_cli.py",
    "test_kept_files.py",
    "test_world.py",
    "test_independence.py",
    "test_terms.py",
    "test_ledger.py",
    "test_water_at_bodies.py",
    "test_adaptation.py",
    "test_adaptation_limits.py",
    "test_shear_relief.py",
    "test_prescribed_bodies.py",
    "test_surface.py",
    "test_projection.py",
)


def pytest_collection_modifyitems(items):
    order = {name: place for place, name in enumerate(LONGEST)}
    items.sort(key=lambda item: order.get(item.path.name, len(LONGEST)))
