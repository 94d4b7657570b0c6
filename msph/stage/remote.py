"""Simulations in another process, and what a window shows of them (link.py)."""

import contextlib
import math
import time
from dataclasses import replace
from functools import partial
from importlib import import_module
from multiprocessing.connection import Connection
from pathlib import Path
from threading import Thread
from typing import Any

import numpy as np

from msph.fluid.boundary.walls import wall_constants
from msph.launches import watch_compiling
from msph.measure.snapshot import Snapshot
from msph.scene.build import roomy_plan_of
from msph.scene.live import read
from msph.stage.controls import Controls, Inputs
from msph.stage.display import Display
from msph.stage.link import END, Answer, Command, Order, Ready, SimulationError
from msph.stage.preparation import Report, compiling, say_ready
from msph.stage.row import PATIENCE, Row
from msph.stage.shown_scene import ShownScene
from msph.state import Moment, Wanted
from msph.transfer import SharedArrays, give_back, own_state, receive

# Time [s] that the process has to end before it is killed: a frame may compile.
LAST_WAIT = 1.0
# Time [s] for which a number is measured after the window has read it.
RECENT = 1.0


class Remote:
    """Process of simulations, of start_simulations(); as a context, it ends the process.

    busy: True while it owes an answer; doing: what it does meanwhile, since `since` [s].
    """

    def __init__(self, process: Any, connection: Connection):
        self.process, self.connection = process, connection
        self.busy, self.doing, self.since = False, "", 0.0
        self.running = False  # True between an order and END
        self.building = False  # True between an order and Ready
        self.serial = 0  # of the last order
        self.left = math.inf  # number of frames that may still be asked for
        self.shows: list[RemoteShow] = []
        self.given = Inputs()  # changes and reset of the next Command
        self.calls: list[tuple[str, tuple]] = []  # of the next Command

    def __enter__(self) -> "Remote":
        return self

    def __exit__(self, *_: Any) -> None:
        with contextlib.suppress(OSError):
            self.end()
            self.connection.send(None)
            if not self.building:
                self.process.join(LAST_WAIT)
        self.process.kill()
        self.process.join()

    def row(
        self, order: Order, size: tuple[int, int], report: Report | None = None, below: int = 0
    ) -> Row:
        """Returns the simulations of an order, in an image of size (width, height) [pixels] with
        `below` free pixels at the lower edge, once both processes are ready. Raises
        SimulationError."""
        self.end()
        begin = time.perf_counter()
        self.serial += 1
        self.left = order.frames or math.inf
        self._send(replace(order, serial=self.serial))
        self.running = self.building = True
        self.doing, self.since = "building the scene", begin
        with compiling(report) as tell, watch_compiling(self._check):
            row = Row.arranged(partial(RemoteShow, self, order), order.labels, size, below)
            row.remote, self.shows = self, row.shows
            self.given, self.calls = Inputs(), []
            for show in self.shows:
                show.warm_up(order.whole)
            ready = self._wait_for(Ready, tell, begin)
        self.building = False
        for show, name in zip(self.shows, ready.names, strict=True):
            try:
                show.arrays = SharedArrays(show.state.plan.max_particles, name)
            except FileNotFoundError:
                raise self._lost() from None
        self._take(self._wait_for(list, tell, begin))
        say_ready(begin, ready.about)
        return row

    def _check(self, _: str) -> None:
        """Raises SimulationError once the process has ended."""
        if not self.process.is_alive():
            raise self._lost()

    def _wait_for(self, kind: type, report: Report, begin: float) -> Any:
        """Returns the next message of a kind."""
        while not isinstance(message := self._receive(PATIENCE), kind):
            report(f"simulation: {self.doing}, {time.perf_counter() - begin:.1f} s")
        return message

    def give(self, controls: Controls) -> None:
        """Sends the input of the next frame, unless an answer is owed or no frame is left."""
        if self.busy or not self.left:
            return
        given, calls, self.given, self.calls = self.given, self.calls, Inputs(), []
        changed = {**given.set, **controls.set}
        controls = replace(controls, set=changed, reset=controls.reset or given.reset)
        self._send(Command(controls, [show.wanted() for show in self.shows], calls))
        self.left -= 1
        self.busy, self.doing, self.since = True, "", time.perf_counter()

    def receive(self, patience: float) -> None:
        """Waits at most `patience` [s] for the answer to the last command."""
        until = time.perf_counter() + patience
        while self.busy:
            message = self._receive(max(until - time.perf_counter(), 0.0))
            if isinstance(message, list):
                self._take(message)
            elif message is None and time.perf_counter() >= until:
                return

    def _take(self, answers: list[Answer]) -> None:
        self.busy = False
        for show, answer in zip(self.shows, answers, strict=True):
            show.take(answer)

    def end(self) -> None:
        """Ends the simulations of the last order."""
        if self.running:
            self.running = self.busy = False
            try:
                self._send(END)
            except SimulationError:
                return
        self.shows = []

    def _send(self, message: Any) -> None:
        try:
            self.connection.send(message)
        except OSError:
            raise self._lost() from None

    def _receive(self, timeout: float) -> Any:
        """Returns the next message, None if there is none within `timeout` [s]."""
        try:
            if not self.connection.poll(timeout):
                return None
            serial, message = self.connection.recv()
        except (EOFError, OSError):
            raise self._lost() from None
        if serial not in (0, self.serial):
            return None
        if isinstance(message, SimulationError):
            self.running = self.building = self.busy = False
            raise message
        if isinstance(message, str):
            self.doing = message
        return message

    def _lost(self) -> SimulationError:
        """Describes the end of the process."""
        self.running = self.busy = False
        self.process.join(LAST_WAIT)
        code = self.process.exitcode
        how = f"signal {-code}" if code and code < 0 else f"exit code {code}"
        return SimulationError(f"the process of the simulation has ended ({how})")


class RemoteShow(ShownScene):
    """Display of a simulation in another process; see Show."""

    parallel = True

    def __init__(self, remote: Remote, order: Order, place: int, size: tuple[int, int]):
        scene = order.scenes[place]
        super().__init__(scene)
        self.remote, self.size = remote, size
        self.frame_time = order.frame_time_of(place)
        spare, room = (order.options.get(name, 0) for name in ("spare", "room"))
        self.interactive = order.options.get("interactive", False)
        self.state = own_state(roomy_plan_of(scene, spare, room))
        self.display: Any = Display(self, size)
        self.arrays: Any = None
        self.simulated, self.fresh, self.new = 0.0, False, False
        self.reported: dict[str, float] = {}
        self.numbers: dict[str, float] = {}
        self.read: dict[str, float] = {}  # time [s] at which a number was read last

    @property
    def now(self) -> Moment:  # type: ignore[override]
        return self.state.now

    def _changed(self, key: str) -> None:
        if key.startswith("picture."):
            self.display.picture.change(self.scene.picture)

    def warm_up(self, whole: bool) -> None:
        """Compiles the kernels of images, by drawing the initial water; for a window without
        `whole`, some of them in later frames."""
        for _ in range(2 if self.interactive else 1):
            self.display.draw()
        self.later = []
        if self.interactive:
            # The panel shows the volume and the bulk density; SciPy takes 0.3 s to import.
            imports = Thread(target=import_module, args=("scipy.ndimage",), daemon=True)
            volume = self.display.surface.mesh.volume
            self.later = [*self.display.later_kernels(), volume, imports.start]
        while whole and self.later:
            self.later.pop(0)()
        self.display.reset()

    def take(self, answer: Answer) -> None:
        """Takes an answer of the simulation."""
        resets = self.now.resets
        # Numbers from before a reset are unknown after it.
        self.numbers = {} if self.remote.given.reset else answer.numbers
        receive(self.state, answer.packet, self.arrays.sets[answer.index])
        self.simulated, self.note = self.now.simulated, answer.note or self.note
        # A recording does not contain the initial state.
        self.fresh = self.interactive or self.simulated > 0.0
        if self.now.fluid > 0.0:  # not while paused
            self.timings.add("fluid", self.now.fluid)
        if self.now.resets != resets:
            self.display.reset()
        if answer.changes != self.reported:
            # A replay or a checkpoint has changed them; own changes are known here.
            self.reported = answer.changes
            for key in self.live:
                value = self.reported.get(key, read(self.initial, key))
                if value != read(self.scene, key):
                    super().set(key, value)

    def set(self, key: str, value: float | None) -> None:
        """Sets a live parameter here at once, and in the simulation with the next input."""
        super().set(key, value)
        self.remote.given.set[key] = value

    def reset(self) -> None:
        """Resets the simulation with the next input."""
        self.remote.given.reset, self.numbers = True, {}

    def number(self, name: str) -> float:
        """Returns a number of the simulation in its last answer (Order.numbers), NaN if it is
        unknown."""
        self.read[name] = time.perf_counter()
        return self.numbers.get(name, math.nan)

    def wanted(self) -> Wanted:
        """Returns what the window needs of the simulation."""
        since = time.perf_counter() - RECENT
        recent = tuple(name for name, when in self.read.items() if when > since)
        return replace(self.display.views.wanted, numbers=recent)

    def frame(self, controls: Controls) -> None:
        """Draws the last state, while the simulation computes the next one."""
        self.new, self.fresh = self.fresh, False
        self.compile_later()
        if self.new or self.interactive:
            self.display.frame(controls, self.new)
        self.timings.close_frame()

    def draw(self) -> None:
        """Draws the last state."""
        self.display.draw()

    def keep(self, checkpoint: Path) -> None:
        """Saves a checkpoint after the present frame."""
        self.remote.calls.append(("keep", (checkpoint,)))

    def reopen(self, checkpoints: list[Path], otherwise: str) -> None:
        """Continues from the first of these checkpoints that fits, or says `otherwise`."""
        self.remote.calls.append(("reopen", (checkpoints, otherwise)))

    def water(self) -> Snapshot:
        particles, plan = self.state.particles, self.state.plan
        walls = np.array(wall_constants(plan.size, plan.open_top)["walls"])
        x = particles.numpy("x").astype(float)
        inside = np.all((x >= 0.0) & (x <= walls), axis=1)
        layer = particles.numpy("layer")[inside]
        spacing, support = (
            np.array([getattr(s, name) for s in self.state.layers.specs])[layer]
            for name in ("spacing", "support")
        )
        free = self.state.boundary.free
        return Snapshot(x[inside], None, spacing, support, self.state.region, free)

    def close(self) -> None:
        """Drops all parts, so that other scenes can use their memory."""
        give_back(self.state)
        if self.arrays:
            self.arrays.close()
        self.display = None
