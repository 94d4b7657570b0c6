"""Wall-clock time per frame and stage. Off, it costs nothing."""

import sys
import time
from collections import defaultdict
from contextlib import contextmanager

import numpy as np
import psutil
import taichi as ti


class Timings:
    """Seconds per frame, split by stage; the device is waited for on both sides of a stage."""

    def __init__(self):
        self.frames: list[dict[str, float]] = []
        self._open: dict[str, float] = defaultdict(float)

    @contextmanager
    def stage(self, name: str):
        ti.sync()
        start = time.perf_counter()
        yield
        ti.sync()
        self._open[name] += time.perf_counter() - start

    def close_frame(self) -> None:
        self.frames.append(dict(self._open))
        self._open.clear()

    def discard(self) -> None:
        """Forgets all frames so far: the warm-up."""
        self.frames.clear()
        self._open.clear()

    def percentile(self, percent: float, *stages: str) -> float:
        """Percentile [s] over frames of the time in the given stages together, or in all."""
        per_frame = [sum(f.get(s, 0.0) for s in (stages or f)) for f in self.frames]
        return float(np.percentile(per_frame, percent))

    def total(self, *stages: str) -> float:
        """Wall-clock time [s] of all frames in the given stages together, or in all."""
        return sum(sum(f.get(s, 0.0) for s in (stages or f)) for f in self.frames)


def peak_memory() -> int:
    """Largest resident size of this process so far [bytes], earlier runs within it included."""
    if sys.platform == "win32":
        return psutil.Process().memory_info().peak_wset
    import resource  # POSIX alone has it

    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit
