"""Helpers that run commands of msph in the process of the tests, and programs in others."""

import contextlib
import io
import signal
import subprocess
import sys
from types import SimpleNamespace

from msph.cli import main


def here(*arguments):
    """Runs a command in this process, with its compiled kernels; returns exit code and output."""
    out, err, code = io.StringIO(), io.StringIO(), 0
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            main([str(a) for a in arguments])
        except SystemExit as end:
            code = end.code or 0
    return SimpleNamespace(returncode=code, stdout=out.getvalue(), stderr=err.getvalue())


def done(*arguments):
    """Runs a command that must succeed, as here(); returns its output."""
    result = here(*arguments)
    assert result.returncode == 0, result.stderr
    return result


def started(*arguments, run=("-m", "msph"), stderr=subprocess.PIPE, **options):
    """Starts a command in a process; returns the process, whose messages can be read."""
    return subprocess.Popen(
        [sys.executable, "-u", *run, *map(str, arguments)],
        stderr=stderr,
        text=True,
        # Tests started in the background ignore SIGINT, and so would the processes that they start.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        **options,
    )


def python(*arguments, timeout=300, may_fail=False, **options):
    """Runs Python in a process, which must succeed unless it may fail; returns the process with its
    output."""
    command = [sys.executable, *map(str, arguments)]
    found = subprocess.run(command, capture_output=True, text=True, timeout=timeout, **options)
    assert may_fail or found.returncode == 0, found.stderr[-2000:]
    return found
