"""Process of the simulations of a window: runs them by the window's commands (link.py)."""

from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any

from msph.device import start
from msph.ending import unexpected
from msph.errors import MsphError
from msph.launches import watch_compiling
from msph.own_files import claim
from msph.scene.errors import SceneError
from msph.stage.autosave import Autosaver
from msph.stage.controls import Controls
from msph.stage.input_relays import InputRecorder, Replayer
from msph.stage.link import END, Answer, Command, Files, Order, Ready, SimulationError
from msph.stage.loop import Audience, Witness, run
from msph.stage.preparation import built_row, described
from msph.stage.progress import Progress
from msph.stage.row import Row
from msph.stage.show import Show
from msph.transfer import SETS, Sender, SharedArrays


def serve(connection: Connection, arch: str, threads: int | None) -> None:
    """Runs orders of the window until it wants no more."""
    try:
        start(arch, threads)
        while (order := connection.recv()) is not None:
            if order != END:  # the simulations had failed when it was sent
                _run(order, connection)
    except MsphError as error:
        connection.send((0, SimulationError(str(error), error.EXIT_CODE)))
    except (EOFError, ConnectionError, KeyboardInterrupt):
        return


def _run(order: Order, connection: Connection) -> None:
    """Builds the simulations of an order and runs them to END; tells the window of errors."""
    row: Row | None = None
    follower: Follower | None = None

    def tell(message: Any) -> None:
        connection.send((order.serial, message))

    try:
        row = built_row(order, report=tell)
        follower = Follower(row, connection.recv, tell, order)
        with watch_compiling(lambda name: tell(f"compiling {name}")):
            audience, witnesses = with_files(follower, row, order)
            follower.begin()
            run(row, audience, witnesses=witnesses)
    except MsphError as error:
        tell(SimulationError(str(error), error.EXIT_CODE))
    except (EOFError, ConnectionError):
        raise
    except Exception as error:
        tell(SimulationError(unexpected(error)))
    finally:
        if follower:
            follower.free()
        if row:
            row.close()


def with_files(audience: Audience, row: Row, order: Order) -> tuple[Audience, list[Witness]]:
    """Returns an audience with replayed input, and the witnesses that record input and save the
    session."""
    files, lead, witnesses = order.files, row.lead, list[Witness]()
    if files.resume:
        _resume(lead, files)
    if files.replay:
        files.replay.check(lead.scene)
        follows = isinstance(audience, Follower)
        paced = follows and order.frames is None
        audience = Replayer(audience, files.replay, in_window=follows, paced=paced)
    if files.record and files.header:
        claim([files.record], force=True)  # the command has asked for leave
        witnesses.append(InputRecorder(files.record, files.header))
    # Simulations side by side, restored one by one, would no longer be in step.
    if files.autosave and files.header and len(row.shows) == 1:
        witnesses.append(Autosaver(files.autosave, files.header))
    return audience, witnesses


def _resume(show: Show, files: Files) -> None:
    """Continues from a checkpoint; that of a lost session becomes the file of this session."""
    assert files.resume
    if not files.autosave:
        show.resume(files.resume)
        return
    try:
        show.resume(files.resume)
        files.resume.replace(files.autosave)
    except (SceneError, OSError) as error:
        show.note = f"{files.resume.name}: {error}"


class Follower(Audience):
    """Gives a row the input of the window, and the window the states of the row. Raises
    TooLongError."""

    def __init__(
        self, row: Row, wait: Callable[[], Any], tell: Callable[[Any], None], order: Order
    ):
        self.row, self.wait, self.tell, frames = row, wait, tell, order.frames
        self.progress = Progress(frames, False, explained=True) if frames else None
        self.numbers = [order.numbers(show) if order.numbers else None for show in row.shows]
        self.arrays = [SharedArrays(show.simulation.plan.max_particles) for show in row.shows]
        self.senders = [Sender(show.state) for show in row.shows]
        self.index, self.given = 0, Command(Controls(), [])

    def begin(self) -> None:
        """Tells the window that the row is ready, and sends the initial state."""
        names = [arrays.name for arrays in self.arrays]
        self.tell(Ready(names, [described(show) for show in self.row.shows]))
        self.observe(self.row)

    def wants_more(self, row: Row) -> bool:
        given = self.wait()
        if given == END:
            return False
        self.given = given
        if self.progress:
            self.progress.start()
        return True

    def controls(self, row: Row) -> Controls:
        for method, arguments in self.given.calls:
            getattr(row.lead, method)(*arguments)
        return self.given.controls

    def observe(self, row: Row) -> None:
        if self.progress and self.given.wanted:
            self.progress.update()
        answers = []
        wanted = self.given.wanted or [show.state.wanted for show in row.shows]
        self.index = (self.index + 1) % SETS
        for show, sender, arrays, want, known in zip(
            row.shows, self.senders, self.arrays, wanted, self.numbers, strict=True
        ):
            show.state.take(show.simulation, show.now, want)
            packet = sender.pack(arrays.sets[self.index])
            numbers = {name: getattr(known, name) for name in want.numbers}
            answers.append(Answer(self.index, packet, show.note, show.changes(), numbers))
            show.note = ""
        self.tell(answers)

    def free(self) -> None:
        """Frees the shared memory."""
        for arrays in self.arrays:
            arrays.close()
