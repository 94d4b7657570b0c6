"""Helper that runs commands of msph in the process of the tests."""

import contextlib
import io
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
