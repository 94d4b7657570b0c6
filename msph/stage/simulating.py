"""Process of the simulations of a window: runs them by the window's commands (link.py)."""

from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any

from msph.device import start
from msph.ending import unexpected
from msph.errors import MsphError
from msph.launches import watch_compiling
from msph.measure.timings import Timings
from msph.own_files import claim
from msph.scene.errors import SceneError
from msph.stage.autosave import Autosave, Autosaver
from msph.stage.controls import Controls
from msph.stage.link import END, Answer, Command, Failed, Files, Order, Progress, Ready
from msph.stage.loop import Audience, run
from msph.stage.preparation import built, described, named, place
from msph.stage.replaying import InputRecorder, Replayer
from msph.stage.row import KEPT_FRAMES, Row
from msph.stage.show import INTERACTIVE, Show
from msph.transfer import SETS, Sender, SharedArrays


def serve(connection: Connection, arch: str, threads: int | None) -> None:
    """Runs orders of the window until it wants no more."""
    try:
        start(arch, threads)
        while (order := connection.recv()) is not None:
            if order != END:  # the simulations had failed when it was sent
                _run(order, connection)
    except MsphError as error:
        connection.send((0, Failed(str(error), error.EXIT_CODE)))
    except (EOFError, ConnectionError, KeyboardInterrupt):
        return


def _run(order: Order, connection: Connection) -> None:
    """Builds the simulations of an order and runs them to END; tells the window of errors."""
    row: Row | None = None
    follower: Follower | None = None
    files = order.files

    def tell(message: Any) -> None:
        connection.send((order.serial, message))

    def doing(text: str, important: bool = False) -> None:
        tell(Progress(text))

    autosave = None
    if files.autosave:
        autosave = Autosave(order.arguments, files.autosave, files.began)
    try:
        row = _build(order, doing)
        follower = Follower(row, connection.recv, tell)
        with watch_compiling(lambda name: doing(f"compiling {name}")):
            audience = _with_files(follower, row, order, autosave)
            follower.begin()
            run(row, audience)
    except MsphError as error:
        tell(Failed(str(error), error.EXIT_CODE))
    except (EOFError, ConnectionError):
        raise
    except Exception as error:
        tell(Failed(unexpected(error), MsphError.EXIT_CODE))
    finally:
        if autosave:
            autosave.writer.shutdown()
        if follower:
            follower.free()
        if row:
            row.close()


def _build(order: Order, report) -> Row:
    """Returns the simulations of an order."""
    number = len(order.scenes)
    shows = [
        built(
            scene,
            1.0 / scene.play.fps,
            report=named(report, place(label, k, number)),
            whole=order.whole,
            timings=Timings(keep=1 if number == 1 else KEPT_FRAMES),
            **INTERACTIVE,
        )
        for k, (scene, label) in enumerate(zip(order.scenes, order.labels, strict=True))
    ]
    return Row(shows)


def _with_files(
    follower: "Follower", row: Row, order: Order, autosave: Autosave | None
) -> Audience:
    """Returns the follower with recording, replay and autosave of its input."""
    files, lead = order.files, row.lead
    audience: Audience = follower
    if files.resume:
        _resume(lead, files)
    if files.replay:
        files.replay.check(lead.scene)
        audience = Replayer(audience, files.replay, in_window=True)
    if files.record and files.header:
        claim([files.record], force=True)  # the window has asked for leave
        audience = InputRecorder(audience, files.record, files.header)
    # Simulations side by side, restored one by one, would no longer be in step.
    if autosave and len(row.shows) == 1:
        audience = Autosaver(audience, autosave, order.choice)
    return audience


def _resume(show: Show, files: Files) -> None:
    """Continues the state of a lost session, whose file becomes the file of this session."""
    assert files.resume and files.autosave
    try:
        show.resume(files.resume)
        files.resume.replace(files.autosave)
    except (SceneError, OSError) as error:
        show.note = f"{files.resume.name}: {error}"


class Follower(Audience):
    """Gives a row the input of the window, and the window the states of the row."""

    def __init__(self, row: Row, wait: Callable[[], Any], tell: Callable[[Any], None]):
        self.row, self.wait, self.tell = row, wait, tell
        self.capacities = [show.simulation.plan.max_particles for show in row.shows]
        self.arrays = [SharedArrays(capacity) for capacity in self.capacities]
        self.senders = [Sender(show.state) for show in row.shows]
        self.index, self.given = 0, Command(Controls(), [])

    def begin(self) -> None:
        """Tells the window that the row is ready, and sends the initial state."""
        names = [arrays.name for arrays in self.arrays]
        self.tell(Ready(names, self.capacities, [described(show) for show in self.row.shows]))
        self.observe(self.row)

    def wants_more(self, row: Row) -> bool:
        given = self.wait()
        if given == END:
            return False
        self.given = given
        return True

    def controls(self, row: Row) -> Controls:
        given = self.given
        if given.keep:
            row.lead.keep(given.keep)
        if given.reopen is not None:
            row.lead.reopen(given.reopen, given.otherwise)
        return given.controls

    def observe(self, row: Row) -> None:
        packets, notes = [], []
        wanted = self.given.wanted or [show.state.wanted for show in row.shows]
        self.index = (self.index + 1) % SETS
        for show, sender, arrays, want in zip(
            row.shows, self.senders, self.arrays, wanted, strict=True
        ):
            show.state.take(show.simulation, show.now, want)
            packets.append(sender.pack(arrays.sets[self.index]))
            notes.append(show.note)
            show.note = ""
        changes = [show.changes() for show in row.shows]
        self.tell(Answer(self.index, packets, notes, changes))

    def free(self) -> None:
        """Frees the shared memory."""
        for arrays in self.arrays:
            arrays.close()
