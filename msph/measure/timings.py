"""Elapsed time per frame and stage; costs nothing if not used."""

import sys
import time
from collections import defaultdict, deque
from contextlib import contextmanager

import numpy as np
import psutil
import taichi as ti

from msph.fluid.stages import no_stage


class Timings:
    """Elapsed time [s] per frame by stage; the device is synchronised before and after a stage.

    A nested stage is named by its path, "fluid/density". Substages, the parts of a step, are timed
    only with `profile`, as synchronisation slows them. keep: number of last frames kept, None: all.
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
        self._open[path] += 0.0  # places parents before their parts
        ti.sync()
        start = time.perf_counter()
        try:
            yield
            ti.sync()
        finally:
            self._path.pop()
        self._open[path] += time.perf_counter() - start

    def spent(self, stage: str) -> float:
        """Returns the time [s] of a stage in the present frame."""
        return self._open.get(stage, 0.0)

    def add(self, stage: str, seconds: float) -> None:
        """Adds the time [s] of a stage that another process has run."""
        self._open[stage] += seconds

    def close_frame(self) -> None:
        self.frames.append(dict(self._open))
        self._open.clear()

    def discard(self) -> None:
        """Discards all frames so far, as after a warm-up."""
        self.frames.clear()
        self._open.clear()

    def percentile(self, percent: float, *stages: str) -> float:
        """Returns a percentile [s] over frames of the time in the given stages, or in all."""
        return float(np.percentile([_time(f, stages) for f in self.frames], percent))

    def total(self, *stages: str) -> float:
        """Returns the elapsed time [s] of all frames in the given stages, or in all."""
        return sum(_time(f, stages) for f in self.frames)

    def tree(self) -> dict[str, float]:
        """Returns the mean time [s] per frame of each stage by its path. Stages precede their
        parts, which are in the order of first use; "other" is the remainder, after the parts."""
        paths = list(dict.fromkeys(path for frame in self.frames for path in frame))
        return self._branch([p for p in paths if "/" not in p], paths)

    def _branch(self, stages: list[str], paths: list[str]) -> dict[str, float]:
        """Returns the mean times [s] of the given stages and of their parts."""
        found = {}
        for stage in stages:
            found[stage] = self.total(stage) / len(self.frames)
            parts = [p for p in paths if p.rpartition("/")[0] == stage]
            found |= self._branch(parts, paths)
            if parts:
                found[f"{stage}/other"] = found[stage] - sum(found[p] for p in parts)
        return found


def _time(frame: dict[str, float], stages: tuple[str, ...]) -> float:
    """Returns the time [s] of a frame in the given stages, or in all top-level stages."""
    return sum(frame.get(s, 0.0) for s in (stages or [s for s in frame if "/" not in s]))


def peak_memory() -> int:
    """Returns the largest resident memory of this process so far [bytes]."""
    if sys.platform == "win32":
        return psutil.Process().memory_info().peak_wset
    import resource  # POSIX only

    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit


def process_age() -> float:
    """Returns the elapsed time [s] since the start of this process."""
    began = psutil.Process().create_time()
    if sys.platform == "linux":
        # create_time() is the boot time, rounded to seconds, plus an exact time since boot.
        return time.clock_gettime(time.CLOCK_BOOTTIME) - (began - psutil.boot_time())
    return time.time() - began
