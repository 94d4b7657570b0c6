"""A water that is played in a process of its own: its start, what runs in it, and its end."""

import contextlib
import multiprocessing
import signal
from collections.abc import Iterator
from ctypes import c_int32
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection

import numpy as np

from msph.device import start
from msph.ending import in_one_line
from msph.interrupts import SIGNALS, held_back, importing
from msph.stage.choice import Called, Choice
from msph.stage.link import Failed, FromWater, Input, Over, Title

# A process that was told to end does so after a frame or a kernel; then it is killed [s].
PATIENCE = 20.0


class WaterProcess:
    """Starts a process that plays a choice, and is what the process of the window knows of it."""

    def __init__(self, choice: Choice, called: Called):
        # Taichi's threads do not survive a fork.
        context = multiprocessing.get_context("spawn")
        width, height = called.size
        shared = context.RawArray(c_int32, width * height)
        self.choice, self.failure = choice, ""
        self.pixels = np.ctypeslib.as_array(shared).reshape(width, height)
        self.link, other = context.Pipe()
        self.process = context.Process(target=perform, args=(other, shared, choice, called))
        try:
            with held_from_children():
                self.process.start()
        except BaseException:
            self.leave()
            raise
        finally:
            other.close()

    def heard(self) -> list[FromWater] | None:
        """What it has said since the last call; None where it has ended, or is about to."""
        said: list[FromWater] = []
        try:
            while self.link.poll():
                said.append(self.link.recv())
        except (EOFError, OSError):
            return said or None
        return said

    def tell(self, message: Input) -> None:
        """What the window has to say; nothing where it has ended."""
        with contextlib.suppress(OSError):
            self.link.send(message)

    def leave(self) -> None:
        """Lets it see that its window is closed: it ends by itself."""
        self.link.close()

    def end(self) -> int:
        """Waits for its end and returns its exit code, negative where a signal ended it."""
        self.leave()
        self.process.join(PATIENCE)
        if self.process.exitcode is None:
            self.process.kill()
            self.process.join()
        return self.process.exitcode or 0


@contextlib.contextmanager
def held_from_children() -> Iterator[None]:
    """Processes started within do not see a terminal's signals: that of the window tells them to
    end. A signal that arrives within is raised behind it, as InterruptedRun: a child whose start
    was cut short would print a traceback."""
    # The mask is inherited, but holds nothing back here: other threads take the signal.
    with held_back() as raise_if_asked, _blocked():
        yield
    raise_if_asked()


@contextlib.contextmanager
def _blocked() -> Iterator[None]:
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    # Where it does not run yet, a first start of a process would let signals through again.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def perform(link: Connection, pixels, choice: Choice, called: Called) -> None:
    """What the process does: plays a choice in the window at the other end of the link."""
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)

    def say(message: FromWater) -> None:
        with contextlib.suppress(OSError):
            link.send(message)

    with in_one_line(lambda line: say(Failed(line))):
        first = next(iter(called.waters_of(choice.scene).values()))
        say(Title(first.title or choice.scene))
        with importing():
            from msph.stage.commands import play_choice
            from msph.stage.remote_window import RemoteWindow
            from msph.stage.window import ClosedError
        arch = start(called.arch, called.threads)
        with contextlib.suppress(ClosedError):
            play_choice(RemoteWindow(link, pixels, called.size), choice, called, arch)
        # Taichi takes its time to end.
        say(Over())
