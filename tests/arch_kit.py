"""Helper for tests on several architectures; each architecture is tested in a separate process,
because a Taichi runtime has one architecture."""

import os

import pytest

from tests.command_kit import python

PROBE = "import taichi as ti; ti.init(arch=ti.{0}); print(ti.lang.impl.current_cfg().arch.name)"


def require(arch):
    """Skips the test if there is no driver for `arch`; fails it instead on the build machine."""
    found = python("-c", PROBE.format(arch), may_fail=True)
    if not found.stdout.strip().endswith(arch):
        assert not os.environ.get("MSPH_REQUIRE_WINDOW"), f"the build machine must have {arch}"
        pytest.skip(f"no {arch} driver")
