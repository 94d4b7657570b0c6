"""The clock of a window: the simulated time of each shown frame, and the scale of its picture.

A frame is given the time that has passed on the wall, times the speed asked for, so that water
moves at that speed at whatever frame rate. Where the machine is too slow for the frame rate wanted,
the picture grows coarser first; time slows last.
"""

import numpy as np

from msph.stage.controls import Controls
from msph.stage.row import Row

# Frame rates that are tried in turn, over the one wanted: better half of it than slow motion.
RATES = (1.0, 0.75, 0.5)
# Scales of the picture: areas halve in two.
SCALES = tuple(2.0 ** (-k / 4.0) for k in range(5))
# Longest frame [s]: time slows rather than that fewer frames are shown.
LONGEST_FRAME = 1.0 / 24.0
# Least share of the longest frame that the water may take, however long the picture takes.
LEAST_WATER = 0.4
# Share of a frame that is planned: the rest is for what costs vary by.
PLANNED = 0.9
# Weight of the past in smoothed times, frames between two looks at the scale, and share of the
# cost of a finer picture by which it must be affordable, or it would come and go.
SMOOTHING, SCALE_INTERVAL, HYSTERESIS = 0.9, 15, 1.15
# Most that the water lags behind [s], and goes on to make up for: a splash, seldom more. A frame
# that takes longer is a halt, of a window that is moved or a kernel that compiles.
BACKLOG = 0.25
# Share of that lag which a frame makes up for, and by how much time runs faster meanwhile at most.
CATCH_UP, MAX_SPEEDUP = 0.1, 0.15
# Most that a frame simulates over the duration of the one before (-): a mean that remembers a slow
# splash would let the water race after it.
MAX_GROWTH = 1.25


class Pacer:
    """fps: shown frames per second wanted. speed (-): simulated over wall-clock time asked for.

    scale (-): of the picture's edges, at most `finest`. last [s]: duration of the last frame. wall
    [s] is that of frames, water, picture and rest [s] what their parts take, simulated [s] what
    they simulate; all smoothed.
    """

    def __init__(self, fps: float, speed: float = 1.0, finest: float = SCALES[0]):
        self.fps, self.speed, self.scale = fps, speed, SCALES[0]
        self.finest = finest
        self.wall = self.last = 1.0 / fps
        self.simulated = speed * self.wall
        self.water = self.picture = self.rest = 0.0
        self.lag = 0.0  # simulated time that the water has yet to make up for [s]
        self.frames = 0

    @property
    def frame_time(self) -> float:
        """Simulated time [s] that the next frame should take."""
        asked = self.speed * min(self.wall, MAX_GROWTH / (1.0 + MAX_SPEEDUP) * self.last)
        wanted = asked + float(
            np.clip(CATCH_UP * self.lag, -MAX_SPEEDUP * asked, MAX_SPEEDUP * asked)
        )
        return float(np.clip(wanted, 0.5 * self.speed / self.fps, self.speed * LONGEST_FRAME))

    @property
    def budget(self) -> float:
        """Wall-clock time [s] that the water of the next frame may take."""
        return max(LONGEST_FRAME - self.picture - self.rest, LEAST_WATER * LONGEST_FRAME)

    @property
    def pace(self) -> float:
        """Simulated over wall-clock time (-)."""
        return self.simulated / self.wall

    def set_speed(self, speed: float) -> None:
        """Asks for another speed."""
        self.speed, self.lag = speed, 0.0
        self.simulated = speed * self.wall

    def steer(self, controls: Controls) -> None:
        """Gives the next frame its time and its picture's scale."""
        controls.frame_time, controls.budget = self.frame_time, self.budget
        controls.scale = self.scale

    def observe(self, row: Row, wall: float, shown: float) -> None:
        """Takes in the row's last frame, of `wall` [s], of which it took `shown` [s] to be shown
        without waiting for the screen."""
        frames = [s.timings.frames[-1] for s in row.shows if s.timings]
        water, surface, picture = (
            sum(frame.get(stage, 0.0) for frame in frames)
            for stage in ("fluid", "surface", "picture")
        )
        self.record(wall, water, picture, surface + shown, row.lead.simulated)

    def record(
        self, wall: float, water: float, picture: float, rest: float, simulated: float
    ) -> None:
        """Takes in a frame: its duration [s], what water, picture and the rest took of it without
        waiting for the screen [s], and what was simulated [s]."""
        wall = self.last = wall if wall <= BACKLOG else LONGEST_FRAME
        self.frames += 1
        past = min(SMOOTHING, 1.0 - 1.0 / self.frames)
        for name, now in (("wall", wall), ("water", water), ("picture", picture), ("rest", rest)):
            setattr(self, name, past * getattr(self, name) + (1.0 - past) * now)
        self.simulated = past * self.simulated + (1.0 - past) * simulated
        behind = self.lag + self.speed * wall - simulated
        self.lag = float(np.clip(behind, -self.speed * BACKLOG, self.speed * BACKLOG))
        if self.frames % SCALE_INTERVAL == 0:
            self.scale = self._affordable()

    def _affordable(self) -> float:
        """The finest picture at the highest frame rate that the machine can hold."""
        per_second = self.speed * self.water / max(self.simulated, 1e-9)
        for rate in RATES:
            room = (PLANNED - per_second) / (rate * self.fps) - self.rest
            for scale in (min(s, self.finest) for s in SCALES):
                cost = self.picture * (scale / self.scale) ** 2
                if cost * (HYSTERESIS if scale > self.scale else 1.0) <= room:
                    return scale
        return min(SCALES[-1], self.finest)
