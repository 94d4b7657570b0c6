"""Pacer of a window: the simulated time and the image scale of each frame.

A frame simulates the elapsed wall-clock time times the requested speed, at any frame rate. On a
machine too slow for the requested frame rate, the image is first rendered at a smaller scale, then
the frame rate falls, and last the simulation slows down.
"""

import numpy as np

from msph.stage.controls import Controls
from msph.stage.row import Row

# Frame rates tried in turn, over the requested rate; half this rate is preferred to slow motion.
RATES = (1.0, 0.75, 0.5)
# Image scales in steps of 0.05; images below the last scale look blurred.
SCALES = tuple(1.0 - 0.05 * k for k in range(9))
# Largest change of the scale at a time.
MAX_CHANGE = 0.1
# Longest frame [s]; slower simulations run slower than real time at this frame rate.
LONGEST_FRAME = 1.0 / 24.0
# Share of a frame that is planned; the rest is a reserve for varying costs.
PLANNED = 0.9
# Weight of the previous mean in smoothed times; frames between two choices of the scale; factor on
# the cost of a finer image, which prevents switching back and forth.
SMOOTHING, SCALE_INTERVAL, HYSTERESIS = 0.9, 6, 1.15
# Largest lag that is caught up [s], the length of a splash. A longer frame counts as a halt (moved
# window, compilation).
BACKLOG = 0.25
# Share of the lag caught up per frame, and limit of the speed-up meanwhile.
CATCH_UP, MAX_SPEEDUP = 0.1, 0.15
# Largest simulated time of a frame over the duration of the last frame (-): the smoothed duration
# is too long after a slow splash.
MAX_GROWTH = 1.25


class Pacer:
    """Controls frame time and image scale. The fluid runs while images are drawn.

    fps: requested frames per second. speed (-): requested simulated over wall-clock time. scale
    (-): image scale, at most `finest`. budget [s]: limit of the fluid's wall-clock time in a frame.
    last [s]: duration of the last frame. Smoothed: wall [s], duration of a frame; fluid, image,
    rest [s], time of its parts; simulated [s].
    """

    budget = LONGEST_FRAME

    def __init__(self, fps: float, speed: float = 1.0, finest: float = SCALES[0]):
        self.fps, self.speed, self.scale, self.finest = fps, speed, SCALES[0], finest
        self.wall = self.last = 1.0 / fps
        self.simulated = speed * self.wall
        self.fluid = self.image = self.rest = 0.0
        self.lag = 0.0  # simulated time to catch up [s]
        # Elapsed time below the requested speed, now and at most, without interruption [s].
        self.slow = self.longest_slow = 0.0
        self.frames = 0

    @property
    def frame_time(self) -> float:
        """Simulated time of the next frame [s]."""
        asked = self.speed * min(self.wall, MAX_GROWTH / (1.0 + MAX_SPEEDUP) * self.last)
        limit = MAX_SPEEDUP * asked
        wanted = asked + float(np.clip(CATCH_UP * self.lag, -limit, limit))
        return float(np.clip(wanted, 0.5 * self.speed / self.fps, self.speed * LONGEST_FRAME))

    @property
    def pace(self) -> float:
        """Real-time factor: simulated over wall-clock time (-)."""
        return self.simulated / self.wall

    def set_speed(self, speed: float) -> None:
        """Requests another speed."""
        self.speed, self.lag = speed, 0.0
        self.simulated = speed * self.wall

    def steer(self, controls: Controls) -> None:
        """Sets frame time, budget and image scale of the next frame."""
        controls.frame_time, controls.budget = self.frame_time, self.budget
        controls.scale = self.scale

    def observe(self, row: Row, wall: float, shown: float) -> None:
        """Records the row's last frame, of duration `wall` [s]; shown [s]: time to present it,
        without the wait for the display."""
        frames = [show.timings.frames[-1] for show in row.shows]
        fluid, surface, image = (
            sum(frame.get(stage, 0.0) for frame in frames)
            for stage in ("fluid", "surface", "picture")
        )
        self.record(wall, fluid, image, surface + shown, row.lead.simulated)

    def record(
        self, wall: float, fluid: float, image: float, rest: float, simulated: float
    ) -> None:
        """Records a frame: its duration, the times of fluid, image and rest without the wait for
        the display, and its simulated time, all in [s]."""
        wall = self.last = wall if wall <= BACKLOG else LONGEST_FRAME
        self.frames += 1
        past = min(SMOOTHING, 1.0 - 1.0 / self.frames)
        for name, now in (("wall", wall), ("fluid", fluid), ("image", image), ("rest", rest)):
            setattr(self, name, past * getattr(self, name) + (1.0 - past) * now)
        self.simulated = past * self.simulated + (1.0 - past) * simulated
        self.slow = self.slow + wall if self.pace < PLANNED * self.speed else 0.0
        self.longest_slow = max(self.longest_slow, self.slow)
        behind = self.lag + self.speed * wall - simulated
        self.lag = float(np.clip(behind, -self.speed * BACKLOG, self.speed * BACKLOG))
        if self.frames % SCALE_INTERVAL == 0:
            change = self._affordable() - self.scale
            self.scale += float(np.clip(change, -MAX_CHANGE, MAX_CHANGE))

    def _affordable(self) -> float:
        """Returns the largest image scale at the highest frame rate that the machine sustains."""
        per_second = self.speed * self.fluid / max(self.simulated, 1e-9)
        if per_second < PLANNED:
            per_second = 0.0  # images do not wait for the fluid
        for rate in RATES:
            room = (PLANNED - per_second) / (rate * self.fps) - self.rest
            for scale in (min(s, self.finest) for s in SCALES):
                cost = self.image * (scale / self.scale) ** 2
                if cost * (HYSTERESIS if scale > self.scale else 1.0) <= room:
                    return scale
        return min(SCALES[-1], self.finest)
