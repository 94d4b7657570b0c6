"""Start and end of the process of the simulations. Imports nothing slow, so that the process starts
first."""

import contextlib
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Iterator
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from typing import Any

from msph.interrupts import SIGNALS, importing

# Signals that a terminal sends to both processes; the window's process handles them.
OF_TERMINAL = {number for number in SIGNALS if number != signal.SIGTERM}
# Option of the tracker of shared memory: what is left by processes that a signal has ended before
# both held it is removed without a warning.
QUIET = "ignore::UserWarning:multiprocessing.resource_tracker"

# The process of the simulations and the connection to it.
Started = tuple[Any, Connection]


@contextlib.contextmanager
def simulations(arch: str, threads: int | None, wanted: bool = True) -> Iterator[Started | None]:
    """Context with the process of the simulations, which ends with it, if it is `wanted`."""
    if not wanted:
        yield None
        return
    process, connection = start_simulations(arch, threads)
    try:
        yield process, connection
    finally:
        process.kill()
        process.join()


def start_simulations(arch: str, threads: int | None) -> Started:
    """Starts the process of the simulations (simulating.py); returns it and the connection to it.
    Works with new interpreters only, as other systems than Linux have nothing else."""
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=_serve, args=(theirs, arch, threads), daemon=True)
    with _hidden_main(), _blocked(OF_TERMINAL):
        process.start()
    theirs.close()
    return process, ours


@contextlib.contextmanager
def _hidden_main() -> Iterator[None]:
    """Context in which a new process does not run the main script again."""
    main = vars(sys.modules["__main__"])
    kept = {name: main[name] for name in ("__file__", "__spec__") if name in main}
    main.pop("__file__", None)
    main["__spec__"] = None
    try:
        yield
    finally:
        main.update(kept)


@contextlib.contextmanager
def _blocked(signals: set[int]) -> Iterator[None]:
    """Context in which signals wait; a process that is started in it never receives them."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    # Its start would let the signals through again.
    sys.warnoptions.append(QUIET)
    try:
        resource_tracker.ensure_running()
    finally:
        sys.warnoptions.remove(QUIET)
    before = signal.pthread_sigmask(signal.SIG_BLOCK, signals)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _serve(connection: Connection, arch: str, threads: int | None) -> None:
    """Entry point of the process."""
    for number in OF_TERMINAL:
        signal.signal(number, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with importing():
        from msph.stage.simulating import serve
    serve(connection, arch, threads)


def _end_with_parent() -> None:
    """Ends this process with one line if its parent process ends first, as when it is killed."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    wait([parent.sentinel])
    os.write(2, b"msph: the main process has ended\n")
    os._exit(1)
