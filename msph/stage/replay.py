"""Replay: states of the last seconds of a row, which can be rendered as a video."""

from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

from msph.stage.lost_display import completing
from msph.stage.recorder import Outputs, Recorder
from msph.stage.row import Row

# Largest duration [s], frame rate, and memory [bytes], which may shorten the duration.
SPAN, FPS, MOST_BYTES = 10.0, 24.0, 256 << 20


class Replay:
    """States of the last frames with their wall-clock times [s]."""

    def __init__(self) -> None:
        self.frames: deque[tuple[float, dict[str, Any]]] = deque()
        self.bytes = 0

    def observe(self, row: Row, now: float) -> None:
        """Stores the row's state at the wall-clock time `now` [s] if a frame is due."""
        if self.frames and now - self.frames[-1][0] < 1.0 / FPS:
            return
        kept = row.moment()
        self.frames.append((now, kept))
        self.bytes += _bytes(kept)
        while len(self.frames) > 1 and (now - self.frames[0][0] > SPAN or self.bytes > MOST_BYTES):
            self.bytes -= _bytes(self.frames.popleft()[1])

    def write(self, row: Row, path: Path, report: Callable[[float], None]) -> None:
        """Renders the stored frames at full scale to a video, then restores the row. Calls
        report(share done) after each frame. Raises LostOutputError."""
        before = row.moment()
        scale, row.picture.scale = row.picture.scale, 1.0
        first, last = self.frames[0][0], self.frames[-1][0]
        number = max(1, round((last - first) * FPS))
        recorder = Recorder(Outputs([path]), number, FPS, bar=False)
        waiting = list(self.frames)
        try:
            with completing(recorder.close):
                for k in range(number):
                    # The newest frame at that time, so that halts keep their length.
                    while len(waiting) > 1 and waiting[1][0] <= first + (k + 0.5) / FPS:
                        waiting.pop(0)
                    row.show_moment(waiting[0][1])
                    recorder.observe(row)
                    report((k + 1) / number)
        finally:
            row.picture.scale = scale
            row.show_moment(before)
            recorder.close()


def _bytes(kept: dict[str, Any]) -> int:
    return sum(value.nbytes for value in kept["state"].values())
