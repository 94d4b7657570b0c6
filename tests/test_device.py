"""Where Taichi's threads run."""

import os
import subprocess
import sys

import pytest

# Prints, a line each, the CPUs that each thread may use which came with Taichi.
SCRIPT = """
import os
import taichi
from msph import device
before = device._threads()
device.start("cpu", {threads})
for thread in device._threads() - before:
    print(*sorted(os.sched_getaffinity(thread)))
"""


def cpus_by_thread(threads):
    script = SCRIPT.format(threads=threads)
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    return [tuple(map(int, line.split())) for line in run.stdout.splitlines()]


@pytest.mark.skipif(not hasattr(os, "sched_getaffinity"), reason="the system does not tell")
def test_each_thread_has_a_cpu_of_its_own():
    """Workers that Linux wakes on the same CPU make two threads as slow as one."""
    ours = os.sched_getaffinity(0)
    found = cpus_by_thread(None)
    assert len(found) >= len(ours)
    assert all(len(cpus) == 1 for cpus in found)
    assert {cpu for (cpu,) in found} == ours


@pytest.mark.skipif(not hasattr(os, "sched_getaffinity"), reason="the system does not tell")
def test_fewer_threads_run_where_they_like():
    """Two runs of one thread each would else share a CPU."""
    assert set(cpus_by_thread(1)) == {tuple(sorted(os.sched_getaffinity(0)))}
