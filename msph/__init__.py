"""M-SPH: real-time multi-layer SPH, large particles in the depth and small ones at the surface."""

import os

__version__ = "0.1.0"

# Scene of a command that is given no scene.
DEFAULT_SCENE = "pool"

# Hides the banner that Taichi prints on import.
os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "False")
