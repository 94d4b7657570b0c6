"""M-SPH: real-time layered water, large particles in the depth and small ones at the surface."""

import os

__version__ = "0.1.0"

# The scene that a command takes where none is named.
DEFAULT_SCENE = "pool"

# Taichi prints a banner when it is imported; our own first lines say what a user needs.
os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "False")
