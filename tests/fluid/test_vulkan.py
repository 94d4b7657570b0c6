"""Runs the tests of scan, sort, grid and neighbour list on Vulkan."""

import os
import subprocess
import sys

import pytest

from tests.arch_kit import require


@pytest.mark.slow
def test_grid_equals_brute_force_on_vulkan():
    """The tests run in a separate process, since a Taichi runtime has one architecture."""
    require("vulkan")
    command = [sys.executable, "-m", "pytest", "-o", "addopts=", "tests/fluid/test_grid.py"]
    environment = {**os.environ, "TI_ARCH": "vulkan"}
    result = subprocess.run(command, capture_output=True, text=True, env=environment)
    assert result.returncode == 0, result.stdout[-2000:]
    assert "passed" in result.stdout
