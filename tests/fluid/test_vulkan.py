"""Scan, sort, grids and neighbour lists once more, on Vulkan."""

import os
import subprocess
import sys

import pytest

PROBE = "import taichi as ti; ti.init(arch=ti.vulkan); print(ti.lang.impl.current_cfg().arch.name)"


def vulkan_is_here():
    found = subprocess.run([sys.executable, "-c", PROBE], capture_output=True, text=True)
    return found.stdout.strip().endswith("vulkan")


def test_grid_equals_brute_force_on_vulkan():
    """In a process of its own: one Taichi runtime has one architecture."""
    if not vulkan_is_here():
        assert not os.environ.get("MSPH_REQUIRE_WINDOW"), "the build machine must have Vulkan"
        pytest.skip("no Vulkan driver")
    command = [sys.executable, "-m", "pytest", "-o", "addopts=", "tests/fluid/test_grid.py"]
    environment = {**os.environ, "TI_ARCH": "vulkan"}
    result = subprocess.run(command, capture_output=True, text=True, env=environment)
    assert result.returncode == 0, result.stdout[-2000:]
    assert "passed" in result.stdout
