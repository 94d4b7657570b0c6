"""What the process of the window and that of a water tell each other. Pixels of pictures lie in
memory that both share."""

from dataclasses import dataclass

import numpy as np

from msph.stage.choice import Choice


@dataclass(frozen=True)
class Title:
    """Of the scene, before anything is built."""

    text: str


@dataclass(frozen=True)
class Progress:
    """How far the start is, a share (0 to 1), and what is being done."""

    share: float
    doing: str


@dataclass(frozen=True)
class Picture:
    """A picture is there; marker: a place, (2,), arrows: from and to, (k, 2, 2), in shares of the
    window."""

    marker: np.ndarray | None
    arrows: np.ndarray | None


@dataclass(frozen=True)
class Wanted:
    """Another scene or quality is to follow."""

    choice: Choice


@dataclass(frozen=True)
class Over:
    """The water has been left by a key, or all its frames were shown."""


@dataclass(frozen=True)
class Failed:
    """The water's process ends; the line says why."""

    line: str


# From a water to the window.
FromWater = Title | Progress | Picture | Wanted | Over | Failed


@dataclass(frozen=True)
class Input:
    """From the window to a water: keys and buttons that went down since the last, and that are
    down; the cursor, (2,), in shares of the window; its width over its height; pictures that were
    shown; what is to be told of the water that follows; processor time [s] that a picture takes to
    be shown."""

    presses: tuple[str, ...]
    held: frozenset[str]
    cursor: np.ndarray
    aspect: float
    shown: int
    notice: str = ""
    display: float = 0.0
