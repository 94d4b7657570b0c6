"""M-SPH: real-time simulation of water by layers of particles, small at the surface, large below.

    import msph
    water = msph.open("dam_break", quality="small")
    water.probe("height", at=(1.2, 0.1))
    for frame in water.frames(seconds=2.0):
        print(frame.time, frame.height, frame.particles.x.max(axis=0))

SI units; y points up, and the origin is the lower corner of the box. docs/python.md has recipes;
`msph --help` is the command line.
"""

import os
from collections.abc import Mapping
from typing import Any

from msph.constants import DEFAULT_SCENE, VERSION

__version__ = VERSION
__all__ = ["Body", "BodyState", "Frame", "MsphError", "Particles", "Water", "open"]

# Hides the banner that Taichi prints on import, and its message in notebooks.
os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "False")
os.environ.setdefault("TI_ENABLE_PYBUF", "0")


def open(
    scene: str | os.PathLike | Mapping[str, Any] = DEFAULT_SCENE,
    quality: str = "large",
    set: Mapping[str, Any] | None = None,
    *,
    arch: str = "auto",
    threads: int | None = None,
) -> "Water":  # type: ignore[name-defined]  # noqa: F821 -- by __getattr__
    """Returns the simulation of a scene at time zero; its first frame compiles kernels.

    scene: a shipped name (`msph scenes` lists them), a scene file, or its tables as a dict
    (docs/scenes.md). quality: "small", "medium", "large" (as the file), "finest", or "auto", the
    finest in real time. set: parameters by key, such as {"gravity": (0, -1.62, 0)} or
    {"layers.0.spacing": 0.02} (`msph scenes --parameters`). arch: "auto", "cpu", "cuda", "vulkan"
    or "metal", and threads: of the CPU, are those of the process, set by the first call; with
    threads=1 runs are bitwise reproducible. Raises MsphError, with the text of the command line.
    """
    from msph.water import Water

    return Water(scene, quality, set or {}, arch, threads)


def __getattr__(name: str) -> Any:
    # Imported when used: help and option errors of the command line need neither Taichi nor numpy,
    # and signals are handled only once the command line is loaded.
    if name not in __all__:
        raise AttributeError(f"module 'msph' has no attribute {name!r}")
    from msph import errors, water

    return getattr(errors if name == "MsphError" else water, name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
