"""The last seconds of a row, kept as states of its water, and drawn again into a video."""

from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

from msph.stage.recorder import Outputs, Recorder
from msph.stage.row import Row

# What is kept: time [s], frames per second, and memory [bytes], which large waters fill sooner.
SPAN, FPS, MOST_BYTES = 10.0, 24.0, 256 << 20


class Replay:
    """Frames are kept by the wall clock, as they were seen."""

    def __init__(self) -> None:
        self.frames: deque[tuple[float, dict[str, Any]]] = deque()
        self.bytes = 0

    def observe(self, row: Row, now: float) -> None:
        """Keeps the row's water at the wall-clock time `now` [s] where a frame is due."""
        if self.frames and now - self.frames[-1][0] < 1.0 / FPS:
            return
        kept = row.moment()
        self.frames.append((now, kept))
        self.bytes += _bytes(kept)
        while len(self.frames) > 1 and (now - self.frames[0][0] > SPAN or self.bytes > MOST_BYTES):
            self.bytes -= _bytes(self.frames.popleft()[1])

    def write(self, row: Row, path: Path, tell: Callable[[float], None]) -> None:
        """Draws what is kept at full scale into a video; tell: called with the share (0 to 1) after
        each frame. The row is afterwards as it was. Raises LostOutputError."""
        before = row.moment()
        scale, row.picture.scale = row.picture.scale, 1.0
        first, last = self.frames[0][0], self.frames[-1][0]
        number = max(1, round((last - first) * FPS))
        recorder = Recorder(Outputs([path]), number, FPS, bar=False)
        waiting = list(self.frames)
        try:
            for k in range(number):
                # The newest frame that had been seen by then: halts are as long as they were.
                while len(waiting) > 1 and waiting[1][0] <= first + (k + 0.5) / FPS:
                    waiting.pop(0)
                row.show_moment(waiting[0][1])
                recorder.observe(row)
                tell((k + 1) / number)
        finally:
            row.picture.scale = scale
            row.show_moment(before)
            recorder.close()


def _bytes(kept: dict[str, Any]) -> int:
    return sum(value.nbytes for value in kept["state"].values())
