"""Error handling of the command line: one line per error, and an exit code by its kind."""

import contextlib
import math
import re
import sys
import time
import traceback
from collections.abc import Iterator
from typing import NoReturn

import click

from msph import user_cache
from msph.constants import VERSION
from msph.device import address_space
from msph.errors import MsphError
from msph.interrupts import handling, raise_interrupt

# Exit codes: wrong use of the command line, and a command ended by Ctrl-C.
USAGE_ERROR, INTERRUPTED = 2, 130
# Messages of Taichi and of C++ about memory.
ALLOCATION = re.compile(r"memory alloc|bad_alloc|out of memory|allocate memory", re.IGNORECASE)
# Largest number of characters printed of an unexpected error.
MAX_LENGTH = 200


@contextlib.contextmanager
def exit_on_error() -> Iterator[None]:
    """Prints any error of the block as one line on stderr and ends the process: exit code 2 for
    wrong input, 128 + number for a signal, 1 for other errors."""
    try:
        with handling(raise_interrupt):
            yield
    except click.exceptions.NoArgsIsHelpError as error:
        error.show()
        sys.exit(USAGE_ERROR)
    except click.ClickException as error:
        fail(error.format_message(), USAGE_ERROR)
    except MsphError as error:
        fail(str(error), error.EXIT_CODE)
    except (click.Abort, KeyboardInterrupt) as error:
        # click turns interrupts into its Abort.
        fail("interrupted", getattr(error.__cause__ or error, "exit_code", INTERRUPTED))
    except Exception as error:
        fail(unexpected(error), MsphError.EXIT_CODE)


def unexpected(error: Exception) -> str:
    """Describes an error without a handler in one line, and writes its traceback to a file."""
    if isinstance(error, OSError) and error.strerror:
        # For example a full disk: paths given by the user are checked earlier.
        where = f"{error.filename}: " if error.filename else ""
        return f"{where}{error.strerror.lower()}"
    if isinstance(error, MemoryError) or ALLOCATION.search(str(error)):
        return f"not enough memory or address space (ulimit -v){limit_in_words()}"
    what = " ".join(f"{type(error).__name__}: {error}".split())
    report = user_cache.file().parent / f"crash_{time.strftime('%Y%m%d_%H%M%S')}.txt"
    command = " ".join(["msph", *sys.argv[1:]])
    text = f"{command}\nmsph {VERSION}, Python {sys.version}\n\n{traceback.format_exc()}"
    try:
        report.parent.mkdir(parents=True, exist_ok=True)
        report.write_text(text, encoding="utf-8", errors="backslashreplace")
    except OSError:
        return f"unexpected error: {what[:MAX_LENGTH]}"
    return f"unexpected error: {what[:MAX_LENGTH]}; details in {report}"


def limit_in_words() -> str:
    """Returns this process's limit of address space, "" if there is none."""
    limit = address_space()
    return "" if math.isinf(limit) else f": the limit is {limit / 2**30:.1f} GiB"


def fail(problem: str, code: int) -> NoReturn:
    """Prints a line on stderr and exits."""
    click.echo(f"msph: {problem}", err=True)
    sys.exit(code)
