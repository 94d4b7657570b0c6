"""Cursor on the water: where a tool acts, and the wake of a hovering cursor."""

from typing import Any

import numpy as np

from msph.stage.controls import ToolUse
from msph.stage.row import Row
from msph.stage.show import Show
from msph.stage.tools import HOVER, PRESS_TIME, Tool


class WaterCursor:
    """The cursor on the water. place: its position [m] in the box frame, None outside of the water;
    over: the show under the cursor; holds: True while a pressed button holds the water; held, tool:
    duration [s] and tool of this hold."""

    def __init__(self) -> None:
        self.place: Any = None
        self.start: Any = None
        self.over: Any = None
        self.tool: Any = None
        self.holds, self.held = False, 0.0

    def hold(self, tool: Tool, row: Row, cursor: np.ndarray, step: float) -> ToolUse | None:
        """Returns the use of a tool by a pressed button in a frame of `step` [s], None without
        water; cursor: (right, up) in shares of the window.

        A touch begins where the cursor's ray meets the water, and continues at that depth, in that
        simulation, with that tool.
        """
        began = not self.holds
        if began:
            self.over, self.tool = row.show_under(cursor)[0], tool
        show, cursor = self.over, row.to_picture(self.over, cursor)
        eye, direction = show.display.ray(*(cursor * show.display.picture.size))
        hit = self._hit(show, cursor)
        if began:
            self.place = self.start = hit
            self.holds, self.held = hit is not None, 0.0
        if not self.holds:
            return None
        axis = show.now.tilt.T @ -show.display.camera.axes()[2]
        before = self.place
        self.place = eye + (before - eye) @ axis / (direction @ axis) * direction
        velocity = (self.place - before) / step
        self.held += step
        surface = self.place if hit is None else hit
        vectors = self.place, velocity, self.start, surface, direction
        return ToolUse.of(self.tool.name, vectors, step, self.held)

    @property
    def clicked(self) -> bool:
        """True during the least duration of a press."""
        return self.holds and self.held < PRESS_TIME

    def pass_over(self, row: Row, cursor: np.ndarray, step: float) -> ToolUse | None:
        """Returns the wake of a cursor that hovers over the water; the wake ends where the cursor
        enters another simulation."""
        show, cursor = row.show_under(cursor)
        if show is not self.over:
            self.let_go()
        self.over = show
        hit = self._hit(show, cursor)
        before, self.place, self.holds = self.place, hit, False
        if hit is None or before is None:
            return None
        direction = show.display.ray(*(cursor * show.display.picture.size))[1]
        vectors = hit, (hit - before) / step, hit, hit, direction
        return ToolUse.of(HOVER.name, vectors, step, step)

    def let_go(self) -> None:
        self.place, self.holds = None, False

    @staticmethod
    def _hit(show: Show, cursor: np.ndarray) -> np.ndarray | None:
        """Returns the point of the water [m], box frame, at the cursor, or None."""
        i, j = cursor * show.display.picture.size
        hit = show.display.pick(int(i), int(j))
        return None if hit is None else np.asarray(hit)
