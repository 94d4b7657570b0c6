"""Start of Taichi on an architecture, with the settings that this project needs."""

import atexit
import contextlib
import gc
import io
import math
import os
import sys
import time
from pathlib import Path

from msph import self_test
from msph.cache_folder import ensure
from msph.errors import BadInputError
from msph.interrupts import importing

ARCHES = ("auto", "cpu", "cuda", "vulkan", "metal")
# Iterations of a heavy kernel's loop that a CPU thread takes at a time, if the loop has no
# block_dim of its own: few enough to divide 300 iterations evenly, however long each takes.
CPU_BLOCK = 16
# Size of Taichi's kernel cache on disk [bytes]: a scene compiles to 2 to 4 MB, so that the default
# of 100 MB is full after a day of work.
CACHE_BYTES = 1 << 30
# Lock file of Taichi's kernel cache, and age [s] beyond which the lock is stale: Taichi holds the
# lock for less than 1 s. A lock left by a killed process disables the cache for all later runs.
LOCK, STALE = "ticache.lock", 60.0
# Address space [bytes] below which no run succeeds, and LLVM may abort without a message.
LEAST_SPACE = 3 << 29
# Threads of this process, on Linux.
THREADS = Path("/proc/self/task")


class ArchError(BadInputError):
    """An architecture that this machine does not have."""


_started: str | None = None


def started() -> bool:
    """Returns True if Taichi runs in this process."""
    return _started is not None


def start(arch: str = "auto", threads: int | None = None, tested: bool = False) -> str:
    """Starts Taichi once and returns the name of the architecture it runs on. Raises ArchError.

    "auto" is CUDA if available, else the CPU. Vulkan is never automatic, since its driver may be a
    software driver, slower than the CPU; nor is Metal, since a Metal window of Taichi 1.7.4 has
    frozen macOS (taichi issue #8775). threads: number of CPU threads, by default one per core, each
    pinned to a core; with 1, all loops of the process run serially. A GPU that fails the self-test
    (self_test.py) is replaced by the CPU; tested: True skips the self-test.
    """
    global _started
    if _started:
        return _started
    if address_space() < LEAST_SPACE:
        raise MemoryError
    ensure()
    if not tested:
        arch = _trusted(arch)
    # Imported here, since help and option errors need no Taichi, which takes 0.2 s to import.
    with importing():
        import taichi as ti

        # Otherwise Taichi imports this module at the first kernel, where an interrupt is lost.
        import taichi.lang.matrix_ops

        from msph.launches import BLOCKS, serialize_loops
        from msph.taichi_internals import GRID, cache_folder, end, on_cpu

    automatic = [ti.cpu] if sys.platform == "darwin" else [ti.cuda, ti.cpu]
    wanted = automatic if arch == "auto" else [getattr(ti, arch)]
    options = {
        GRID: BLOCKS,
        "default_cpu_block_dim": CPU_BLOCK,
        "offline_cache_max_size_of_files": CACHE_BYTES,
        # The kernel that fills a table unrolls its columns; Taichi would warn from 32 on.
        "unrolling_limit": 0,
    }
    if threads:
        options["cpu_max_num_threads"] = threads
    unlock(cache_folder())
    # Otherwise Taichi asks a server for newer versions in a thread, without a network at every
    # start, and a process that ends while the thread runs may crash.
    os.environ.setdefault("TI_SKIP_VERSION_CHECK", "ON")
    before = _threads()
    # Hides Taichi's line with the architecture.
    with importing(), contextlib.redirect_stdout(io.StringIO()):
        ti.init(arch=wanted, log_level=ti.ERROR, **options)
    # At its end, Python would search all objects for cycles, for 0.4 s.
    atexit.register(gc.freeze)
    # Taichi writes its kernel cache when its program is destroyed, which the end of Python does not
    # always do.
    atexit.register(end)
    if on_cpu():
        # Taichi's control-flow analysis and its search for common subexpressions take more than
        # half of the compile time and gain nothing: LLVM removes the same loads and operations.
        ti.cfg.cfg_optimization, ti.cfg.opt_level = False, 0
    name = "cpu" if on_cpu() else ti.cfg.arch.name
    if arch not in ("auto", name):
        raise ArchError(f"--arch {arch}: not available on this machine, or without a driver")
    if name == "cpu" and threads == 1:
        serialize_loops()
    if name == "cpu" and not threads:
        _pin(_threads() - before)
    _started = name
    return name


def address_space() -> float:
    """Returns this process's limit of address space [bytes], infinite if there is none."""
    try:
        import resource
    except ImportError:  # Windows
        return math.inf
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    return math.inf if limit == resource.RLIM_INFINITY else limit


def _trusted(arch: str) -> str:
    """Returns `arch`, or "cpu" if the GPU of this architecture fails the self-test."""
    gpu = arch
    if arch == "auto":
        gpu = "cpu" if sys.platform == "darwin" else "cuda"
    failed = None if gpu == "cpu" else self_test.failed_test(gpu)
    if failed:
        print(f"{gpu} failed the self-test '{failed}': running on the CPU", file=sys.stderr)
    return "cpu" if failed else arch


def unlock(cache: Path | None) -> None:
    """Removes a stale lock, left by a killed process, from Taichi's kernel cache."""
    if cache:
        # Another process may remove the lock first, or the folder may belong to another user.
        with contextlib.suppress(OSError):
            lock = cache / LOCK
            if time.time() - lock.stat().st_mtime > STALE:
                lock.unlink()


def _threads() -> set[int]:
    """Returns the thread ids of this process; empty on other systems than Linux."""
    return {int(task.name) for task in THREADS.iterdir()} if THREADS.is_dir() else set()


def _pin(threads: set[int]) -> None:
    """Pins each thread to a CPU of its own, in turn, where the system allows it.

    Linux wakes Taichi's workers on one CPU and separates them only after milliseconds: unpinned,
    loops of 0.2 to 2.5 ms take as long on two threads as on one.
    """
    if hasattr(os, "sched_setaffinity"):
        cpus = sorted(os.sched_getaffinity(0))
        for k, thread in enumerate(sorted(threads)):
            # A thread may have ended meanwhile, or a container may forbid pinning.
            with contextlib.suppress(OSError):
                os.sched_setaffinity(thread, {cpus[k % len(cpus)]})
