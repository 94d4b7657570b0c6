"""The last seconds of a show, kept as states of its water, and drawn again into a video."""

from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

from msph.stage.recorder import Outputs, Recorder
from msph.stage.row import Waters

# What is kept: time [s], frames per second, and memory [bytes], which large waters fill sooner.
SPAN, FPS, MOST_BYTES = 10.0, 24.0, 256 << 20


class Replay:
    """Frames are kept by the wall clock, as they were seen."""

    def __init__(self) -> None:
        self.frames: deque[tuple[float, dict[str, Any]]] = deque()
        self.bytes = 0

    def see(self, show: Waters, now: float) -> None:
        """Keeps the show's water at the wall-clock time `now` [s] where a frame is due."""
        if self.frames and now - self.frames[-1][0] < 1.0 / FPS:
            return
        kept = show.moment()
        self.frames.append((now, kept))
        self.bytes += _bytes(kept)
        while len(self.frames) > 1 and (now - self.frames[0][0] > SPAN or self.bytes > MOST_BYTES):
            self.bytes -= _bytes(self.frames.popleft()[1])

    def write(self, show: Waters, path: Path, tell: Callable[[float], None]) -> None:
        """Draws what is kept at full scale into a video; tell: called with the share (0 to 1) after
        each frame. The show is afterwards as it was. Raises LostOutputError."""
        before = show.moment()
        scale, show.picture.scale = show.picture.scale, 1.0
        first, last = self.frames[0][0], self.frames[-1][0]
        number = max(1, round((last - first) * FPS))
        recorder = Recorder(Outputs([path]), number, FPS, bar=False)
        waiting = list(self.frames)
        try:
            for k in range(number):
                # The newest frame that had been seen by then: halts are as long as they were.
                while len(waiting) > 1 and waiting[1][0] <= first + (k + 0.5) / FPS:
                    waiting.pop(0)
                show.see_again(waiting[0][1])
                recorder.see(show)
                tell((k + 1) / number)
        finally:
            show.picture.scale = scale
            show.see_again(before)
            recorder.close()


def _bytes(kept: dict[str, Any]) -> int:
    return sum(value.nbytes for value in kept["state"].values())
