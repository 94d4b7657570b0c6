"""Signals that end a run: at once while nothing can be lost, else when a frame is whole."""

import contextlib
import signal
import threading
import warnings
from collections.abc import Callable, Iterator

# Exit status of a process that a signal ended, less the signal's number: the shells' convention.
BY_SIGNAL = 128
# Ctrl-C, the end of a batch job, and a terminal that is closed; Windows lacks the last.
SIGNALS = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
)


class InterruptedRun(KeyboardInterrupt):
    """A signal asked the run to end; files hold what there was until then."""

    def __init__(self, number: int):
        super().__init__("interrupted")
        self.exit_code = BY_SIGNAL + number


@contextlib.contextmanager
def importing() -> Iterator[None]:
    """Within, libraries are imported or start. Ctrl-C ends the process, and nothing is said: they
    would lose the exception in a callback, or print a traceback. Deprecations and their
    old string escapes (SyntaxWarning) are not for users."""
    with warnings.catch_warnings(), _sudden_end():
        warnings.simplefilter("ignore", DeprecationWarning)
        warnings.simplefilter("ignore", SyntaxWarning)
        yield


@contextlib.contextmanager
def _sudden_end() -> Iterator[None]:
    python_heeds = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if not python_heeds or threading.current_thread() is not threading.main_thread():
        yield
        return
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@contextlib.contextmanager
def deferred_signals() -> Iterator[Callable[[], None]]:
    """Within, a first signal waits for a call of the function given, which raises InterruptedRun; a
    second one raises it at once. Signals that the process ignores stay ignored."""
    asked: list[int] = []

    def ask(number: int, _) -> None:
        asked.append(number)
        if len(asked) > 1:
            raise InterruptedRun(number)

    def raise_if_signalled() -> None:
        if asked:
            raise InterruptedRun(asked[0])

    before = {}
    if threading.current_thread() is threading.main_thread():
        heeded = [n for n in SIGNALS if signal.getsignal(n) != signal.SIG_IGN]
        before = {number: signal.signal(number, ask) for number in heeded}
    try:
        yield raise_if_signalled
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
