"""One window for one water after another: the next is made ready while the last plays on."""

from collections.abc import Callable
from multiprocessing.connection import wait

import numpy as np

from msph.errors import MsphError
from msph.interrupts import held_back
from msph.stage.choice import Choice
from msph.stage.controls import HEARD
from msph.stage.ggui_window import GguiWindow
from msph.stage.link import Failed, FromWater, Input, Over, Picture, Progress, Title, Wanted
from msph.stage.water_process import WaterProcess
from msph.stage.window import ClosedError

# Time after which the window is shown once more, so that keys and mouse are heard [s].
POLL = 0.1


class LostWaterError(MsphError):
    """The process of the water that plays is gone, and could not say why."""


class WindowServer:
    """Shows the pictures of waters' processes and tells them of keys and mouse. first: the process
    that is to play first; begin: starts another; open_window: for a scene's title."""

    def __init__(
        self,
        first: WaterProcess,
        begin: Callable[[Choice], WaterProcess],
        open_window: Callable[[str], GguiWindow],
    ):
        self.begin, self.open_window = begin, open_window
        self.window: GguiWindow | None = None
        self.playing: WaterProcess | None = None
        self.coming: WaterProcess | None = first
        self.left: list[WaterProcess] = []
        self.progress = Progress(0.0, "starting")  # of what comes
        self.notice = ""
        # The last picture, its pixels, and how many the water that plays has had shown.
        self.picture, self.pixels = Picture(None, None), np.empty((0, 0), np.int32)
        self.shown = 0
        self.display = 0.0  # processor time that the display takes for a picture [s]
        self.code: int | None = None

    def serve(self) -> int:
        """Until the window is closed or the water that plays ends; the exit code. Raises
        NoWindowError, and InterruptedRun where a signal asks for it."""
        with held_back() as raise_if_asked:
            try:
                while self.code is None:
                    self._hear()
                    self._look()
                    raise_if_asked()
            except ClosedError:
                self.code = 0
            finally:
                self._close()
        return self.code

    # Waters.

    def _hear(self) -> None:
        """Waits for the waters to say something, for a while."""
        waters = [water for water in (self.coming, self.playing) if water]
        wait([water.link for water in waters], POLL)
        for water in waters:
            # It may have been left for what another has said.
            said = [] if water in self.left else water.heard()
            if said is None:
                self._ended(water)
            for message in said or ():
                self._take(water, message)

    def _take(self, water: WaterProcess, message: FromWater) -> None:
        match message:
            case Title(text):
                if not self.window:
                    self.window = self.open_window(text)
                    self.display = self.window.processor_time()
                water.tell(self._input((), 0))
            case Progress(share, _):
                self.progress = message
                self.notice = f"{water.choice.scene}: {100.0 * share:.0f} % ready"
            case Picture():
                if water is self.coming:
                    self._change(water)
                self.picture, self.pixels = message, water.pixels.copy()
                self.shown += 1
            case Wanted(choice):
                self._make_ready(choice)
            case Over():
                self.code = 0
            case Failed(line):
                water.failure = line

    def _make_ready(self, choice: Choice) -> None:
        """Begins a water that is to follow, in place of another that was to."""
        if self.coming:
            self._leave(self.coming)
        self.coming = self.begin(choice)
        self.notice = f"{choice.scene}: starting"

    def _change(self, water: WaterProcess) -> None:
        """Plays the water that was made ready in place of that which played."""
        if self.playing:
            self._leave(self.playing)
        self.playing, self.coming = water, None
        self.shown, self.notice = 0, ""

    def _leave(self, water: WaterProcess) -> None:
        water.leave()
        self.left.append(water)

    def _ended(self, water: WaterProcess) -> None:
        code = water.end()
        why = water.failure or f"the process of its water was ended by signal {-code}"
        if water is self.coming and self.playing:
            self.coming = None
            self.notice = f"{water.choice.scene}: {why}"
        elif code < 0:
            raise LostWaterError(f"{water.choice.scene}: {why}")
        else:
            self.code = code

    # The window.

    def _look(self) -> None:
        """Shows what there is, and tells the water that plays of keys and mouse."""
        if not self.window or self.code is not None:
            return
        if not self.playing:
            self.window.tell(self.progress.share, self.progress.doing)
            return
        if self.picture.marker is not None:
            self.window.mark(self.picture.marker)
        if self.picture.arrows is not None:
            self.window.arrows(self.picture.arrows)
        self.window.show(self.pixels)
        if not self.window.open:
            raise ClosedError
        self.playing.tell(self._input(tuple(self.window.presses()), self.shown))

    def _input(self, presses: tuple[str, ...], shown: int) -> Input:
        assert self.window
        held = frozenset(key for key in HEARD if self.window.down(key))
        cursor, aspect = self.window.cursor(), self.window.aspect
        return Input(presses, held, cursor, aspect, shown, self.notice, self.display)

    def _close(self) -> None:
        """Ends what there is; the window first, since waters end after a frame or a kernel."""
        if self.window:
            self.window.close()
        waters = [water for water in (self.playing, self.coming, *self.left) if water]
        for water in waters:
            water.leave()
        for water in waters:
            water.end()
