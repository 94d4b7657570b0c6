"""Small scene for tests: two layers, fewer than 400 particles, quick to compile and run; and the
settings of tests with random input."""

import os

from hypothesis import HealthCheck, settings

from msph.scene import load_scene

# Factor of the numbers of random examples. Without it the same examples are drawn in each run.
MORE = int(os.environ.get("MSPH_EXAMPLES", "0"))

# Box of two layers without water, and water of both layers, or of the coarser layer only.
POOL = """
title = "A small pool of two layers"
source = "tests"
duration = 0.2

[box]
size = [0.4, 0.4, 0.4]

[[layers]]
spacing = 0.04
[[layers]]
spacing = 0.0504
"""
LAYERED = """
[[water]]
layer = 1
lo = [0, 0, 0]
hi = [0.4, 0.1008, 0.4]

[[water]]
lo = [0, 0.1008, 0]
hi = [0.4, 0.18, 0.4]
"""
WATER = """
[[water]]
layer = 1
lo = [0, 0, 0]
hi = [0.4, 0.1512, 0.4]
"""
TEXT = f'method = "classic"\n{POOL}[classic]\nviscosity = 10.0\n{LAYERED}'

GAUGE = """
[[probes]]
name = "gauge"
kind = "height"
at = [0.2, 0.2]
"""

# Water in the lower half of a cube of 1 m, with two layers.
CUBE = """
[box]
size = [1.0, 1.0, 1.0]
[[layers]]
mass = 0.3
[[layers]]
spacing = 0.1
[[water]]
lo = [0, 0, 0]
hi = [1, 0.5, 1]
"""

# Long tank without waves.
TANK = """
duration = 4.0
[box]
size = [2.0, 0.6, 0.2]
[[layers]]
spacing = 0.04
[[water]]
lo = [0, 0, 0]
hi = [2, 0.4, 0.2]
"""


def write(folder, text=TEXT, name="small.toml"):
    path = folder / name
    path.write_text(text)
    return str(path)


def load(folder, text=TEXT, *overrides):
    """Writes and loads a scene."""
    return load_scene(write(folder, text), overrides)


def examples(number: int) -> settings:
    """Returns the settings of a test with a number of random examples."""
    return settings(
        deadline=None,
        derandomize=not MORE,
        max_examples=number * max(MORE, 1),
        suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
    )
