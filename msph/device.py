"""Where kernels run."""

import atexit
import contextlib
import io
import os
import sys
import time
from pathlib import Path

from msph import self_test
from msph.cache_folder import ensure
from msph.errors import BadInputError
from msph.interrupts import importing

ARCHES = ("auto", "cpu", "cuda", "vulkan", "metal")
# Iterations of a CPU loop that a thread takes at once.
CPU_BLOCK = 64
# Room for compiled kernels on the disk [bytes]: a scene has 2 to 4 MB of them, and the 100 MB that
# Taichi gives them are full after a day of work.
CACHE_ROOM = 1 << 30
# Taichi's lock on its cache of kernels, and the age [s] from which on nobody holds it: Taichi does
# for less than a second. One left by a process that was killed makes every later start a cold one.
LOCK, STALE = "ticache.lock", 60.0
# Threads of this process, on Linux.
THREADS = Path("/proc/self/task")


class ArchError(BadInputError):
    """An architecture that this machine does not have, in one line."""


_started: str | None = None


def start(arch: str = "auto", threads: int | None = None, tested: bool = False) -> str:
    """Starts Taichi once and returns the name of the architecture it runs on.

    "auto" takes CUDA where there is one, else the CPU. Vulkan must be asked for, since its driver
    may be a software one, slower than the CPU itself; Metal must be asked for, since a Metal window
    of Taichi 1.7.4 has frozen macOS (taichi issue #8775). Unless `threads` are asked for, a CPU
    runs as many as it has cores, each on its own; with one, for the rest of the process, loops are
    not shared out at all. Where a GPU fails the self-test (self_test.py), which a GPU said to be
    `tested` is spared, the CPU is taken, as a line on the error stream says. Raises ArchError.
    """
    global _started
    if _started:
        return _started
    ensure()
    if not tested:
        arch = _trusted(arch)
    # Here, since help and bad options need no Taichi, which takes .2 s to import.
    with importing():
        import taichi as ti

        # Taichi would import it at the first kernel, and lose an interrupt meanwhile.
        import taichi.lang.matrix_ops

        from msph.taichi_internals import cache_folder, on_cpu, serialize_loops

    wanted = {
        "auto": [ti.cpu] if sys.platform == "darwin" else [ti.cuda, ti.cpu],
        "cpu": [ti.cpu],
        "cuda": [ti.cuda],
        "vulkan": [ti.vulkan],
        "metal": [ti.metal],
    }[arch]
    # Unless told otherwise Taichi shares out CPU loops in blocks of at least 512, so that of two
    # threads one would get two thirds of 1,500 particles.
    options = {
        "cpu_block_dim_adaptive": False,
        "default_cpu_block_dim": CPU_BLOCK,
        "offline_cache_max_size_of_files": CACHE_ROOM,
    }
    if threads:
        options["cpu_max_num_threads"] = threads
    unlock(cache_folder())
    before = _threads()
    # Taichi prints what it starts on; commands say it where it matters.
    with importing(), contextlib.redirect_stdout(io.StringIO()):
        ti.init(arch=wanted, log_level=ti.ERROR, **options)
    # Taichi writes its cache of kernels as its program is destroyed; the end of Python alone does
    # not always destroy it.
    atexit.register(ti.reset)
    if on_cpu():
        # Taichi's control-flow analysis takes half of a first start, since its time grows faster
        # than a kernel's length. LLVM removes the same loads and stores: kernels are as fast.
        ti.cfg.cfg_optimization = False
    name = "cpu" if on_cpu() else ti.cfg.arch.name
    if arch not in ("auto", name):
        raise ArchError(f"--arch {arch}: this machine has none, or no driver for it")
    if name == "cpu" and threads == 1:
        serialize_loops()
    if name == "cpu" and not threads:
        _keep_apart(_threads() - before)
    _started = name
    return name


def _trusted(arch: str) -> str:
    """Returns the architecture asked for, or "cpu" if the GPU that it would run on fails the
    self-test."""
    gpu = arch
    if arch == "auto":
        gpu = "cpu" if sys.platform == "darwin" else "cuda"
    failed = None if gpu == "cpu" else self_test.failed_test(gpu)
    if failed:
        print(f"{gpu} failed the self-test '{failed}': running on the CPU", file=sys.stderr)
    return "cpu" if failed else arch


def unlock(cache: Path | None) -> None:
    """Removes the lock of a folder of compiled kernels that a killed process has left."""
    if cache:
        # Another process may do the same, or the folder belong to somebody else.
        with contextlib.suppress(OSError):
            lock = cache / LOCK
            if time.time() - lock.stat().st_mtime > STALE:
                lock.unlink()


def _threads() -> set[int]:
    """Threads of this process, where the system names them."""
    return {int(task.name) for task in THREADS.iterdir()} if THREADS.is_dir() else set()


def _keep_apart(threads: set[int]) -> None:
    """Gives each thread a CPU of its own, in turn, where the system lets us.

    Linux wakes Taichi's workers on one CPU and parts them only after milliseconds: loops of .2 to
    2.5 ms then took as long on two threads as on one, and take half as long on two CPUs.
    """
    if hasattr(os, "sched_setaffinity"):
        cpus = sorted(os.sched_getaffinity(0))
        for k, thread in enumerate(sorted(threads)):
            # One may have ended meanwhile, or a container may forbid it.
            with contextlib.suppress(OSError):
                os.sched_setaffinity(thread, {cpus[k % len(cpus)]})
