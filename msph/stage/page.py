"""Page over the image of a window: painted only if it changes, with widgets for the mouse."""

import math
from collections.abc import Callable, Hashable

import numpy as np

from msph.picture.overlay import Overlay
from msph.stage.sheet import Button, Sheet, Slider


class Page:
    """A page with its place in an overlay. sheet: what is painted on it, None before the first;
    held: widget on which the left button was pressed, until it is up.

    A frame may contain a press, a motion and a release. The cursor is known only once per frame, so
    a press belongs to the widget under the cursor now or, without one, in the previous frame.
    """

    def __init__(self, overlay: Overlay, name: str):
        self.overlay, self.name = overlay, name
        self.shown: Hashable = None  # what the page shows, and where
        self.sheet: Sheet | None = None
        self.held: Button | None = None
        self.down, self.before = False, (math.nan, math.nan)

    def show(
        self,
        content: Hashable,
        paint: Callable[[], Sheet],
        at: tuple[float, float],
        align: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        """Shows the page, painted again if its content or place differs from the last, or hides it
        if the content is None. at: place from the left and the upper edge of the image [pixels] of
        the point `align` of the page, from (0, 0), its upper left corner, to (1, 1)."""
        if content is None:
            self.hide()
            return
        shown = content, at, align
        if shown == self.shown:
            return
        self.shown, self.sheet = shown, paint()
        left, top = (p - round(a * s) for p, a, s in zip(at, align, self.sheet.size, strict=True))
        self.overlay.put(self.name, self.sheet.pixels, round(left), round(top))

    def hide(self) -> None:
        self.overlay.hide(self.name)
        self.shown = self.held = None

    def position(self, cursor: np.ndarray) -> tuple[float, float]:
        """Converts a cursor from (right, up) in shares of the image to (right, down) in pixels from
        the page's upper left corner; both are NaN for a hidden page."""
        if self.name not in self.overlay.shown:
            return math.nan, math.nan
        left, low, _, height = self.overlay.shown[self.name]
        right, up = cursor * self.overlay.size
        return float(right - left), float(low + height - up)

    def covers(self, cursor: np.ndarray) -> bool:
        """Returns True if a cursor, (right, up) in shares of the image, is on the page."""
        x, y = self.position(cursor)
        if math.isnan(x):
            return False
        _, _, width, height = self.overlay.shown[self.name]
        return 0.0 <= x <= width and 0.0 <= y <= height

    def act(self, cursor: np.ndarray, down: bool, pressed: bool) -> tuple[str, float | None] | None:
        """Returns name and value of the slider held or released in this frame, or the name of the
        button clicked (pressed and released on it) and None. cursor: (right, up) in shares of the
        image; down: state of the left button; pressed: True if it was pressed since the last call.
        """
        place = self.position(cursor)
        if pressed or (down and not self.down):
            self.held = self._widget_at(place) or self._widget_at(self.before)
        self.down, self.before = down, place
        held, self.held = self.held, self.held if down else None
        if isinstance(held, Slider):
            return held.name, held.value(place[0])
        return (held.name, None) if held and not down and held.under(*place) else None

    def _widget_at(self, place: tuple[float, float]) -> Button | None:
        widgets = self.sheet.widgets if self.sheet else []
        return next((w for w in widgets if w.under(*place)), None)
