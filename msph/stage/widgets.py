"""Sliders and buttons painted on a page of the window.

GGUI's own widgets are 13 pixels high at any window size, in a panel that moves when dragged.
"""

import math
from dataclasses import dataclass, field
from typing import Any

from msph.stage.pages import FAINT, INK, LINE, WARNING

# Radius of a slider's knob, distance of its value, padding of a button [text heights]; width of a
# track [pixels].
KNOB, AWAY, PADDING, STROKE = 0.38, 0.5, 0.35, 4
# Colours of a track, a button and the selected button.
TRACK, BUTTON, CHOSEN = (86, 112, 130, 255), (27, 51, 71, 255), (58, 92, 112, 255)


@dataclass(frozen=True)
class Button:
    """Button with its rectangle [pixels from the page's corner]."""

    name: str
    left: float
    right: float
    top: float
    bottom: float

    def under(self, x: float, y: float) -> bool:
        return self.left <= x <= self.right and self.top <= y <= self.bottom


@dataclass(frozen=True)
class Slider(Button):
    """Slider for values from lo to hi: track from left to right, active from top to bottom."""

    lo: float
    hi: float

    def value(self, x: float) -> float:
        """Returns the value with the knob at x."""
        share = min(max((x - self.left) / (self.right - self.left), 0.0), 1.0)
        return self.lo + share * (self.hi - self.lo)

    def under(self, x: float, y: float) -> bool:
        """Returns True if a point is on the slider, including a knob at an end."""
        reach = 0.5 * (self.bottom - self.top)
        return self.left - reach <= x <= self.right + reach and self.top <= y <= self.bottom


@dataclass
class Sheet:
    """Widgets of a page. draw, font: PIL objects; text: text height [pixels]."""

    draw: Any
    font: Any
    text: int
    sliders: list[Slider] = field(default_factory=list)
    buttons: list[Button] = field(default_factory=list)

    def slider(
        self, name: str, value: float, span: tuple[float, float], x: tuple[float, float], y: float
    ) -> None:
        """Draws a slider for the values of `span`, from x[0] to x[1], in the line below y."""
        high = LINE * self.text
        self.sliders.append(Slider(name, *x, y, y + high, *span))
        middle, r = y + 0.5 * high, KNOB * self.text
        self.draw.line((x[0], middle, x[1], middle), TRACK, STROKE)
        knob = x[0] + (value - span[0]) / (span[1] - span[0]) * (x[1] - x[0])
        self.draw.ellipse((knob - r, middle - r, knob + r, middle + r), WARNING)

    def button(self, name: str, label: str, x: tuple[float, float], y: float, chosen: bool) -> None:
        """Draws a button in the line below y."""
        high = LINE * self.text
        self.buttons.append(Button(name, *x, y, y + high))
        self.draw.rectangle((x[0], y + 1, x[1], y + high - 2), CHOSEN if chosen else BUTTON)
        place = x[0] + PADDING * self.text, y + 0.5 * high
        self.draw.text(place, label, INK if chosen else FAINT, self.font, anchor="lm")


class Grip:
    """Mouse interaction with a sheet: holds the pressed widget until the left button is up.

    A frame may contain a press, a motion and a release. The cursor is known only once per frame, so
    a press belongs to the widget under the cursor now or, without one, in the previous frame.
    """

    def __init__(self) -> None:
        self.slider: Slider | None = None
        self.button: Button | None = None
        self.down = False
        self.before: tuple[float, float] = (math.nan, math.nan)

    def act(
        self, sheet: Sheet | None, x: float, y: float, down: bool, pressed: bool
    ) -> Slider | Button | None:
        """Returns the slider held or released in this frame, or the button clicked (pressed and
        released on it). x, y: cursor [pixels from the page's corner]; down: state of the left mouse
        button; pressed: True if it was pressed since the last call."""
        if pressed or (down and not self.down):
            found = self._find(sheet, ((x, y), self.before)) if sheet else None
            self.slider, self.button = (found, None) if isinstance(found, Slider) else (None, found)
        self.down, self.before = down, (x, y)
        slider, button = self.slider, self.button
        if not down:
            self.slider = self.button = None
            return button if button and button.under(x, y) else slider
        return slider

    @staticmethod
    def _find(sheet: Sheet, places: tuple[tuple[float, float], ...]) -> Button | None:
        """Returns the widget under the first of these places that is on a widget, or None."""
        widgets: list[Button] = [*sheet.sliders, *sheet.buttons]
        return next((w for place in places for w in widgets if w.under(*place)), None)

    @property
    def holds(self) -> bool:
        """True while the left button is held on a widget."""
        return self.slider is not None or self.button is not None
