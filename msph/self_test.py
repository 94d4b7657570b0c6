"""Self-test of a GPU: results of kernels against NumPy, once per device, driver and Taichi version.

Some drivers and some versions of Taichi compile wrong code for a GPU, or crash. So the self-test
runs in a process of its own, `python -m msph.self_test ARCH`, before this process starts Taichi.
The test takes about 2 s on a GPU in addition to compilation, and its kernels are cached for the
simulation. The outcome is stored in the user's cache.
"""

import os
import subprocess
import sys
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path

from msph import user_cache
from msph.gpu_name import gpu_name

PASSED, CRASHED, SLOW = "passed", "start, or another that crashed", "time limit"
# Time limit of the test [s], which includes compilation on a software driver.
LONGEST = 180.0


def failed_test(arch: str) -> str | None:
    """Returns the name of the test that fails on the GPUs of this machine under `arch`; None if all
    pass, or if the machine names no such GPU. Runs the test unless its outcome is stored."""
    name = gpu_name(arch)
    if name is None:
        return None
    key = f"self-test of {arch}: {name}; Taichi {version('taichi')}"
    outcome = user_cache.recall(key, str)
    if outcome is None:
        print(f"testing {name}, once for this driver", file=sys.stderr)
        outcome = in_own_process(arch)
        # A timeout is not stored: a machine that is busy now may be faster the next time.
        if outcome != SLOW:
            user_cache.remember(key, outcome)
    return None if outcome == PASSED else outcome


def in_own_process(arch: str) -> str:
    """Runs the tests in a new process; returns PASSED, CRASHED, SLOW or a failed test's name."""
    package = str(Path(__file__).parent.parent)
    path = os.pathsep.join(p for p in (package, os.environ.get("PYTHONPATH")) if p)
    command = [sys.executable, "-m", "msph.self_test", arch]
    try:
        done = subprocess.run(
            command,
            capture_output=True,
            text=True,
            timeout=LONGEST,
            env={**os.environ, "PYTHONPATH": path},
        )
    except subprocess.TimeoutExpired:
        return SLOW
    lines = done.stdout.strip().splitlines()
    return lines[-1] if done.returncode == 0 and lines else CRASHED


def first_failure(tests: dict[str, Callable[[], bool]]) -> str:
    """Returns PASSED or the name of the first test that returns False or raises."""
    for name, test in tests.items():
        try:
            passed = test()
        # Taichi raises RuntimeError and other errors for code that a driver rejects.
        except Exception:
            passed = False
        if not passed:
            return name
    return PASSED


def main(arch: str) -> None:
    """Runs the tests under `arch`, and prints the outcome."""
    from msph.device import start

    start(arch, tested=True)
    # The kernels of this module need Taichi to be started.
    from msph.self_tests import TESTS

    print(first_failure(TESTS))


if __name__ == "__main__":
    main(sys.argv[1])
