"""Handling of signals that end a run: at once while libraries load, otherwise between steps."""

import contextlib
import os
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterator
from typing import Any

# Exit status of a process ended by a signal, minus the signal's number (shell convention).
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


def raise_interrupt(number: int, _) -> None:
    """Signal handler: raises InterruptedRun."""
    raise InterruptedRun(number)


def end_at_once(number: int, _) -> None:
    """Signal handler: ends the process, and those that it has started, with one line."""
    if processes := sys.modules.get("multiprocessing"):
        for process in processes.active_children():
            process.kill()
    os.write(2, b"msph: interrupted\n")
    os._exit(SIGNAL_EXIT + number)


# Handlers that a context may replace; a signal that the process ignores stays ignored.
REPLACEABLE = (signal.SIG_DFL, signal.default_int_handler, raise_interrupt)


@contextlib.contextmanager
def handling(handler: Callable[[int, Any], None]) -> Iterator[None]:
    """Context in which `handler` receives SIGNALS, in the main thread."""
    before = {}
    if threading.current_thread() is threading.main_thread():
        replaced = [n for n in SIGNALS if signal.getsignal(n) in REPLACEABLE]
        before = {number: signal.signal(number, handler) for number in replaced}
    try:
        yield
    finally:
        for number, old in before.items():
            signal.signal(number, old)


@contextlib.contextmanager
def importing() -> Iterator[None]:
    """Context for importing or starting libraries: signals end the process at once, since libraries
    lose the exception in callbacks. Hides DeprecationWarning and SyntaxWarning."""
    with warnings.catch_warnings(), handling(end_at_once):
        warnings.simplefilter("ignore", DeprecationWarning)
        warnings.simplefilter("ignore", SyntaxWarning)
        yield


@contextlib.contextmanager
def deferred_signals() -> Iterator[Callable[[], None]]:
    """Yields a function that raises InterruptedRun if a signal has arrived in the context; a second
    signal raises InterruptedRun immediately."""
    received: list[int] = []

    def receive(number: int, _) -> None:
        received.append(number)
        if len(received) > 1:
            raise InterruptedRun(number)

    def raise_if_signalled() -> None:
        if received:
            raise InterruptedRun(received[0])

    with handling(receive):
        yield raise_if_signalled
