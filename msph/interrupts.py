"""Handling of signals that end a run: immediate while libraries load, else between two frames."""

import contextlib
import signal
import threading
import warnings
from collections.abc import Callable, Iterator

# Exit status of a process ended by a signal is this plus the signal's number (shell convention).
SIGNAL_EXIT = 128
# Ctrl-C, the end of a batch job, and a closed terminal (absent on Windows).
SIGNALS = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
)


class InterruptedRun(KeyboardInterrupt):
    """A run ended by a signal; its files hold all frames until then."""

    def __init__(self, number: int):
        super().__init__("interrupted")
        self.exit_code = SIGNAL_EXIT + number


@contextlib.contextmanager
def importing() -> Iterator[None]:
    """Context for importing or starting libraries: Ctrl-C ends the process at once and silently,
    since libraries lose the exception in callbacks. Hides DeprecationWarning and SyntaxWarning."""
    default = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    killable = default and threading.current_thread() is threading.main_thread()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        warnings.simplefilter("ignore", SyntaxWarning)
        if killable:
            signal.signal(signal.SIGINT, signal.SIG_DFL)
        try:
            yield
        finally:
            if killable:
                signal.signal(signal.SIGINT, signal.default_int_handler)


@contextlib.contextmanager
def deferred_signals() -> Iterator[Callable[[], None]]:
    """Yields a function that raises InterruptedRun if a signal has arrived since; a second signal
    raises it immediately. Signals that the process ignores stay ignored."""
    received: list[int] = []

    def receive(number: int, _) -> None:
        received.append(number)
        if len(received) > 1:
            raise InterruptedRun(number)

    def raise_if_signalled() -> None:
        if received:
            raise InterruptedRun(received[0])

    before = {}
    if threading.current_thread() is threading.main_thread():
        handled = [n for n in SIGNALS if signal.getsignal(n) != signal.SIG_IGN]
        before = {number: signal.signal(number, receive) for number in handled}
    try:
        yield raise_if_signalled
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
