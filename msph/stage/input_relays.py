"""Recording of the input of an audience, and its replacement by a recording."""

import math
import time
from dataclasses import replace
from pathlib import Path

from msph.own_files import writing
from msph.stage.controls import Controls, Inputs
from msph.stage.loop import Audience, Witness
from msph.stage.preparation import say
from msph.stage.recorded_input import Header, RecordedFrame, Recording, line_of
from msph.stage.row import Row


class InputRecorder(Witness):
    """Writes the input of each frame to a file (recorded_input.py), line by line, so that
    the file of a program that was killed is complete. The recording ends where the simulation
    continues from a checkpoint. Raises LostOutputError."""

    def __init__(self, path: Path, header: Header):
        self.path, self.lines = path, [line_of(header)]  # lines: not written yet
        self.frame, self.input, self.time = -1, Inputs(), 0.0
        self.written = Inputs()  # input of the last line
        self.began = self.ended = False

    def given(self, row: Row, controls: Controls) -> None:
        now = row.lead.simulation.time
        self.frame += 1
        if self.frame and now != self.time:
            self.ended = True
            say(f"{self.path} ends here: the simulation continues from a checkpoint")
        self.input, self.time = controls.inputs(), now

    def observe(self, row: Row) -> None:
        given, lead = self.input, row.lead
        if given.still:
            given = replace(given, frame_time=None)
        else:
            asked = given.frame_time or lead.frame_time
            until = lead.simulated if 0.0 < lead.simulated < asked else None
            given = replace(given, frame_time=asked, until=until)
        # A pause needs no line for each of its frames.
        if not self.ended and (not given.still or given != self.written):
            self.lines.append(line_of(RecordedFrame(self.frame, self.time, given)))
            with writing(self.path), open(self.path, "a" if self.began else "w") as file:
                file.writelines(self.lines)
            self.lines, self.began, self.written = [], True, given
        self.time = lead.simulation.time


class Replayer(Audience):
    """Replaces the input that an audience gives to the simulation by a recording.

    The audience sees each frame in which time passes. in_window: it sees all frames, and gives the
    input after the end of the recording. paced: frames are not faster than at play.speed.
    """

    def __init__(
        self,
        inner: Audience,
        recording: Recording,
        in_window: bool = False,
        paced: bool = False,
    ):
        self.inner, self.progress = inner, inner.progress
        self.frames, self.in_window, self.paced = recording.frames, in_window, paced
        self.done = 0
        self.last = Inputs()
        self.begin = math.inf  # earliest wall-clock time of the next frame [s]

    @property
    def over(self) -> bool:
        return self.done == len(self.frames)

    def wants_more(self, row: Row) -> bool:
        return (self.in_window or not self.over) and self.inner.wants_more(row)

    def close(self) -> None:
        self.inner.close()

    def controls(self, row: Row) -> Controls:
        controls = self.inner.controls(row)
        if self.over:
            return controls
        if controls.still:
            # During a pause by the user the pool keeps its tilt.
            given = Inputs(still=True, tilt=self.last.tilt, azimuth=self.last.azimuth)
        else:
            given = self.last = self.frames[self.done].input
            self.done += 1
        return replace(controls, **vars(given), budget=None)

    def observe(self, row: Row) -> None:
        simulated = row.lead.simulated
        if self.in_window and self.over and self.frames:
            row.lead.note, self.frames, self.done = "the recorded input ends here", [], 0
        elif self.paced and not self.over:
            self._wait(simulated, row.lead.scene.play.speed)
        if self.in_window or simulated > 0.0:
            self.inner.observe(row)

    def _wait(self, simulated: float, speed: float) -> None:
        """Waits until a frame's simulated time [s] over `speed` has passed since the last frame."""
        now = time.perf_counter()
        # A frame that took longer than it simulated is not caught up.
        self.begin = max(min(self.begin, now) + simulated / speed, now)
        time.sleep(self.begin - now)
