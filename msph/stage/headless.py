"""Audiences that see nothing: the benchmarks."""

import time

from msph.stage.controls import Controls
from msph.stage.pacer import Pacer
from msph.stage.show import Show


class Headless:
    """Wants `frames` frames and touches nothing."""

    def __init__(self, frames: int):
        self.frames = frames
        self.done = 0

    def wants_more(self, show: Show) -> bool:
        return self.done < self.frames

    def controls(self, show: Show) -> Controls:
        return Controls()

    def see(self, show: Show) -> None:
        self.done += 1

    def close(self) -> None:
        pass


class HeadlessPlayer:
    """Plays for `seconds` [s] of wall-clock time by the clock of a window, on a screen that shows
    at most `fps` frames per second, without a hand on the keys.

    walls [s], simulated [s] and scales (-) are those of each frame.
    """

    def __init__(self, seconds: float, fps: float):
        self.seconds, self.least = seconds, 1.0 / fps
        self.pacer = Pacer(fps)
        self.walls: list[float] = []
        self.simulated: list[float] = []
        self.scales: list[float] = []
        self.begin = self.clock = time.perf_counter()

    def wants_more(self, show: Show) -> bool:
        if not self.walls:
            self.begin = self.clock = time.perf_counter()
        return time.perf_counter() - self.begin < self.seconds

    def controls(self, show: Show) -> Controls:
        wishes = Controls()
        self.pacer.steer(wishes)
        return wishes

    def see(self, show: Show) -> None:
        # The screen waits for its next refresh.
        time.sleep(max(0.0, self.clock + self.least - time.perf_counter()))
        now = time.perf_counter()
        wall, self.clock = now - self.clock, now
        self.scales.append(self.pacer.scale)
        self.pacer.see(show, wall, 0.0)
        self.walls.append(wall)
        self.simulated.append(show.simulated)

    def close(self) -> None:
        pass
