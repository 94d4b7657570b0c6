"""Helpers that run commands of msph in the process of the tests, and programs in others."""

import contextlib
import io
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


def python(*arguments, timeout=300, **options):
    """Runs Python in a process; returns the process with its output."""
    command = [sys.executable, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=timeout, **options)
