"""Commands of msph run in this process."""

import contextlib
import io
from types import SimpleNamespace

from msph.cli import main


def here(*arguments):
    """A command in this process, which shares its kernels; its exit code and what it prints."""
    out, err, code = io.StringIO(), io.StringIO(), 0
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            main([str(a) for a in arguments])
        except SystemExit as end:
            code = end.code or 0
    return SimpleNamespace(returncode=code, stdout=out.getvalue(), stderr=err.getvalue())
