"""Wall-clock time per frame and stage. Off, it costs nothing."""

import sys
import time
from collections import defaultdict, deque
from contextlib import contextmanager

import numpy as np
import psutil
import taichi as ti

from msph.fluid.stages import no_stage


class Timings:
    """Seconds per frame, by stage; the device is waited for on both sides of a stage.

    Stages nest: one entered within another goes by its path, "fluid/density". Substages, the parts
    of a step, are timed only with `profile`, for the waiting slows them. Of all frames the last
    `keep` are kept, by default all.
    """

    def __init__(self, profile: bool = False, keep: int | None = None):
        self.frames: deque[dict[str, float]] = deque(maxlen=keep)
        self.substage = self.stage if profile else no_stage
        self._open: dict[str, float] = defaultdict(float)
        self._path: list[str] = []

    @contextmanager
    def stage(self, name: str):
        self._path.append(name)
        path = "/".join(self._path)
        self._open[path] += 0.0  # parents before their parts
        ti.sync()
        start = time.perf_counter()
        try:
            yield
            ti.sync()
        finally:
            self._path.pop()
        self._open[path] += time.perf_counter() - start

    def close_frame(self) -> None:
        self.frames.append(dict(self._open))
        self._open.clear()

    def discard(self) -> None:
        """Forgets all frames so far: the warm-up."""
        self.frames.clear()
        self._open.clear()

    def percentile(self, percent: float, *stages: str) -> float:
        """Percentile [s] over frames of the time in the given stages together, or in all."""
        return float(np.percentile([_time(f, stages) for f in self.frames], percent))

    def total(self, *stages: str) -> float:
        """Wall-clock time [s] of all frames in the given stages together, or in all."""
        return sum(_time(f, stages) for f in self.frames)

    def tree(self) -> dict[str, float]:
        """Mean time [s] per frame of every stage by its path, each before its parts and these in
        the order of their first beginnings; last of the parts, as "other", what is in none."""
        paths = list(dict.fromkeys(path for frame in self.frames for path in frame))
        return self._branch([p for p in paths if "/" not in p], paths)

    def _branch(self, stages: list[str], paths: list[str]) -> dict[str, float]:
        """Of the given stages and all that are within them."""
        found = {}
        for stage in stages:
            found[stage] = self.total(stage) / len(self.frames)
            parts = [p for p in paths if p.rpartition("/")[0] == stage]
            found |= self._branch(parts, paths)
            if parts:
                found[f"{stage}/other"] = found[stage] - sum(found[p] for p in parts)
        return found


def _time(frame: dict[str, float], stages: tuple[str, ...]) -> float:
    """Time [s] of a frame in the given stages, or in all that are part of no other."""
    return sum(frame.get(s, 0.0) for s in (stages or [s for s in frame if "/" not in s]))


def peak_memory() -> int:
    """Largest resident size of this process so far [bytes], earlier runs within it included."""
    if sys.platform == "win32":
        return psutil.Process().memory_info().peak_wset
    import resource  # POSIX alone has it

    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit


def process_age() -> float:
    """Wall-clock time [s] since this process began."""
    began = psutil.Process().create_time()
    if sys.platform == "linux":
        # There it is whole seconds of the boot, rounded, plus an exact time since.
        return time.clock_gettime(time.CLOCK_BOOTTIME) - (began - psutil.boot_time())
    return time.time() - began
