"""Headless clients of the frame loop, used by the benchmarks."""

import time

from msph.stage.controls import Controls
from msph.stage.loop import Audience
from msph.stage.pacer import Pacer
from msph.stage.progress import Progress
from msph.stage.row import Row


class Headless(Audience):
    """Runs a fixed number of frames with the same input, by default none. Raises TooLongError."""

    def __init__(self, frames: int, controls: Controls | None = None):
        self.frames, self.given = frames, controls or Controls()
        self.done = 0
        self.progress = Progress(frames, shown=False)

    def wants_more(self, row: Row) -> bool:
        return self.done < self.frames

    def controls(self, row: Row) -> Controls:
        return self.given

    def observe(self, row: Row) -> None:
        self.done += 1
        self.progress.update()


class HeadlessPlayer(Audience):
    """Plays for `seconds` [s] of wall-clock time as a window without input does, on a display of
    `fps` frames per second; presenting a frame takes no time.

    walls [s], simulated [s], scales (-), residuals (-): wall-clock time, simulated time, image
    scale and solver residual of each frame.
    """

    def __init__(self, seconds: float, fps: float):
        self.seconds, self.refresh = seconds, 1.0 / fps
        self.pacer = Pacer(fps)
        self.walls: list[float] = []
        self.simulated: list[float] = []
        self.scales: list[float] = []
        self.residuals: list[float] = []
        self.begin = self.shown = time.perf_counter()

    def wants_more(self, row: Row) -> bool:
        if not self.walls:
            self.begin = self.shown = time.perf_counter()
        row.receive()
        return time.perf_counter() - self.begin < self.seconds

    def controls(self, row: Row) -> Controls:
        controls = Controls()
        self.pacer.steer(controls)
        return controls

    def observe(self, row: Row) -> None:
        if not row.lead.new:
            return
        # The display waits for its next refresh.
        time.sleep(max(0.0, self.shown + self.refresh - time.perf_counter()))
        now = time.perf_counter()
        wall, self.shown = now - self.shown, now
        self.scales.append(self.pacer.scale)
        self.pacer.observe(row, wall, 0.0)
        self.walls.append(wall)
        self.simulated.append(row.lead.simulated)
        self.residuals.append(row.lead.now.solver_residual)
