"""Tests of the start of Taichi: CPUs of its threads, its kernel cache, choice of architecture."""

import os
import sys
import time

import pytest
import taichi as ti

from msph import device
from tests.command_kit import python

# Prints a line for each thread that Taichi started: the CPUs that the thread may use.
SCRIPT = """
import os
import threading
import taichi
from msph import device
before = device._threads()
device.start("cpu", {threads})
for thread in device._threads() - before:
    try:
        print(*sorted(os.sched_getaffinity(thread)))
    except ProcessLookupError:
        pass  # it ended meanwhile
assert threading.active_count() == 1, "a thread of Taichi's asks for newer versions"
"""


def cpus_by_thread(threads):
    # It compiles nothing, and other tests write and clean the cache of kernels at the same time.
    environment = {**os.environ, "TI_OFFLINE_CACHE": "0"}
    run = python("-c", SCRIPT.format(threads=threads), env=environment)
    return [tuple(map(int, line.split())) for line in run.stdout.splitlines()]


@pytest.mark.skipif(not hasattr(os, "sched_getaffinity"), reason="the system does not tell")
def test_each_thread_has_a_cpu_of_its_own():
    """Two threads that Linux wakes on the same CPU are as slow as one."""
    ours = os.sched_getaffinity(0)
    found = cpus_by_thread(None)
    assert len(found) >= len(ours)
    assert all(len(cpus) == 1 for cpus in found)
    assert {cpu for (cpu,) in found} == ours


@pytest.mark.skipif(not hasattr(os, "sched_getaffinity"), reason="the system does not tell")
def test_fewer_threads_are_not_pinned():
    """Threads of a given number are not pinned: two runs of one thread each would share a CPU."""
    assert set(cpus_by_thread(1)) == {tuple(sorted(os.sched_getaffinity(0)))}


def test_a_lock_that_a_killed_process_left_is_removed(tmp_path):
    """With a lock no kernel is read from the cache or written to it."""
    lock = tmp_path / device.LOCK
    device.unlock(tmp_path)
    lock.touch()
    device.unlock(tmp_path)
    assert lock.exists()
    long_ago = time.time() - 2.0 * device.STALE
    os.utime(lock, (long_ago, long_ago))
    device.unlock(tmp_path)
    assert not lock.exists()


# Starts after the imports of the program's commands, and compiles a kernel.
STARTED = """
import msph.stage.commands
from msph.device import start
start("cpu")
import taichi as ti

@ti.kernel
def number() -> ti.i32:
    return 7

number()
"""


def test_compiled_kernels_are_cached_in_the_folder_of_taichis_environment_variable(tmp_path):
    """Regression: depending on the order in which Python removed modules at exit, Taichi did not
    shut down, and every start compiled all kernels."""
    (tmp_path / device.LOCK).touch()
    os.utime(tmp_path / device.LOCK, (0.0, 0.0))
    (tmp_path / "started.py").write_text(STARTED)
    environment = {**os.environ, "TI_OFFLINE_CACHE_FILE_PATH": str(tmp_path)}
    environment["PYTHONPATH"] = os.getcwd()
    python(tmp_path / "started.py", env=environment)
    assert not (tmp_path / device.LOCK).exists()
    assert list(tmp_path.glob("*.tic"))


def test_auto_selects_the_cpu_on_macos(monkeypatch):
    """A Metal window of Taichi 1.7.4 has frozen macOS (taichi issue #8775)."""
    asked = []
    monkeypatch.setattr(sys, "platform", "darwin")
    monkeypatch.setattr(device, "_started", None)
    monkeypatch.setattr(device.atexit, "register", lambda function: None)
    monkeypatch.setattr(device, "_pin", lambda threads: None)
    monkeypatch.setattr(ti, "init", lambda arch, **options: asked.append(arch))
    device.start("auto", 2)
    assert asked == [[ti.cpu]]
