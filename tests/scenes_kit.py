"""Small scene for tests: two layers, fewer than 400 particles, quick to compile and run."""

TEXT = """
title = "A small pool of two layers"
source = "tests"
duration = 0.2
method = "classic"

[box]
size = [0.4, 0.4, 0.4]

[[layers]]
spacing = 0.04
[[layers]]
spacing = 0.0504

[classic]
viscosity = 10.0

[[water]]
layer = 1
lo = [0, 0, 0]
hi = [0.4, 0.1008, 0.4]

[[water]]
lo = [0, 0.1008, 0]
hi = [0.4, 0.18, 0.4]
"""

# Water of the coarser layer only, to replace the water of both layers.
WATER = """
[[water]]
layer = 1
lo = [0, 0, 0]
hi = [0.4, 0.1512, 0.4]
"""


def write(folder, text=TEXT, name="small.toml"):
    path = folder / name
    path.write_text(text)
    return str(path)
