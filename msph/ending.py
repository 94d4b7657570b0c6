"""How a process ends: whatever went wrong is one line, and the exit code says of which kind."""

import contextlib
import sys
import time
import traceback
from collections.abc import Callable, Iterator

import click

import msph
from msph import user_cache
from msph.errors import MsphError

# Exit codes: wrong use of the command line, and a command that Ctrl-C ended.
BAD_USE, INTERRUPTED = 2, 130
# Letters of an unforeseen error that are said.
LONGEST = 200


@contextlib.contextmanager
def exit_on_error(tell: Callable[[str], None] | None = None) -> Iterator[None]:
    """Within, every error is one line on the error stream and ends the process: wrong input with 2,
    a signal with 128 and its number. tell: who else is told the line."""
    try:
        yield
    except click.exceptions.NoArgsIsHelpError as error:
        error.show()
        sys.exit(BAD_USE)
    except click.ClickException as error:
        fail(error.format_message(), BAD_USE, tell)
    except MsphError as error:
        fail(str(error), error.EXIT_CODE, tell)
    except (click.Abort, KeyboardInterrupt) as error:
        # click turns interrupts into its Abort.
        fail("interrupted", getattr(error.__cause__ or error, "exit_code", INTERRUPTED), tell)
    except Exception as error:
        fail(unexpected(error), MsphError.EXIT_CODE, tell)


def unexpected(error: Exception) -> str:
    """In one line an error that no code expects; details are in a file of its own."""
    if isinstance(error, OSError) and error.strerror:
        # A disk that is full or gone: files that users name are checked before.
        where = f"{error.filename}: " if error.filename else ""
        return f"{where}{error.strerror.lower()}"
    what = " ".join(f"{type(error).__name__}: {error}".split())
    report = user_cache.file().parent / f"crash_{time.strftime('%Y%m%d_%H%M%S')}.txt"
    command = " ".join(["msph", *sys.argv[1:]])
    text = f"{command}\nmsph {msph.__version__}, Python {sys.version}\n\n{traceback.format_exc()}"
    try:
        report.parent.mkdir(parents=True, exist_ok=True)
        report.write_text(text, encoding="utf-8", errors="backslashreplace")
    except OSError:
        return f"unforeseen: {what[:LONGEST]}"
    return f"unforeseen: {what[:LONGEST]}; details in {report}"


def fail(problem: str, code: int, tell: Callable[[str], None] | None = None) -> None:
    """Says in one line what went wrong, and exits."""
    click.echo(f"msph: {problem}", err=True)
    if tell:
        tell(problem)
    sys.exit(code)
