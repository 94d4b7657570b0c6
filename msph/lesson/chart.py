"""Base of boards: style, and a figure that is drawn many times."""

from abc import ABC, abstractmethod
from typing import Any, ClassVar

import numpy as np

from msph.lesson.boards import Input
from msph.lesson.typeset import pyplot

# Colours on a dark background, distinguishable with colour blindness (Okabe and Ito 2008).
GROUND, INK, FAINT = "#0a141e", "#f5f7fa", "#8aa4b4"
COLOURS = ("#56b4e9", "#e69f00", "#009e73", "#cc79a7", "#f0e442")
RED = "#ff6b5e"
DPI = 100
# Text height over image height, and least text height [pixels].
TEXT, MIN_TEXT = 1.0 / 28.0, 18


class Board(ABC):
    """Diagram with numbers. INPUTS: inputs by slider name; NUMBERS: units of its numbers, by name.
    PANELS: relative widths of its axes, side by side; SOLID: True if the last has three dimensions.

    Layout and ticks take most of the time of a drawing, so they are found once per size.
    """

    INPUTS: ClassVar[dict[str, Input]]
    NUMBERS: ClassVar[dict[str, str]]
    PANELS: ClassVar[tuple[int, ...]] = (1, 1)
    SOLID: ClassVar[bool] = False

    def __init__(self) -> None:
        self.size: tuple[int, int] | None = None
        self.drawing: Any = None
        self.common: list[set[Any]] = []  # artists of each axes that all images share

    @abstractmethod
    def numbers(self, values: dict[str, float]) -> dict[str, float]:
        """Returns the numbers for the inputs."""

    @abstractmethod
    def prepare(self, axes: list[Any]) -> None:
        """Draws the parts that all images share."""

    @abstractmethod
    def paint(self, axes: list[Any], values: dict[str, float]) -> None:
        """Draws the parts that depend on the inputs."""

    def draw(self, values: dict[str, float], size: tuple[int, int]) -> np.ndarray:
        """Returns the diagram for the inputs, of size (width, height) [pixels]: (height, width, 3)
        uint8, first row at the top."""
        if size != self.size:
            with pyplot().rc_context(style(size)):
                self._build(size)
        for ax, common in zip(self.drawing.axes, self.common, strict=True):
            for artist in set(ax.get_children()) - common:
                artist.remove()
        self.paint(self.drawing.axes, values)
        self.drawing.canvas.draw()
        return np.asarray(self.drawing.canvas.buffer_rgba())[..., :3].copy()

    def _build(self, size: tuple[int, int]) -> None:
        plt = pyplot()
        if self.drawing is not None:
            plt.close(self.drawing)
        self.size = size
        self.drawing = plt.figure(figsize=(size[0] / DPI, size[1] / DPI), dpi=DPI)
        grid = self.drawing.add_gridspec(1, len(self.PANELS), width_ratios=self.PANELS)
        last = len(self.PANELS) - 1
        for k in range(len(self.PANELS)):
            kind = "3d" if self.SOLID and k == last else None
            self.drawing.add_subplot(grid[0, k], projection=kind)
        self.prepare(self.drawing.axes)
        for ax in self.drawing.axes:
            ax.tick_params(colors=FAINT, labelsize=ax.title.get_size())
        # Ticks are made when they are first drawn, and the layout leaves room for titles.
        for ax in self.drawing.axes:
            ax.set_title(" ")
        self.drawing.canvas.draw()
        self.drawing.set_layout_engine("none")
        self.common = [set(ax.get_children()) for ax in self.drawing.axes]


def style(size: tuple[int, int]) -> dict[str, Any]:
    """Returns matplotlib's settings for an image of size (width, height) [pixels]."""
    points = 72.0 / DPI * max(MIN_TEXT, TEXT * size[1])
    return {
        "font.size": points,
        "axes.titlesize": points,
        "axes.facecolor": GROUND,
        "figure.facecolor": GROUND,
        "text.color": INK,
        "axes.labelcolor": INK,
        "axes.edgecolor": FAINT,
        "figure.constrained_layout.use": True,
    }


def legend(ax: Any, lines: list[Any]) -> None:
    """Adds a legend of these lines in the upper right corner."""
    size = ax.title.get_size()
    ax.legend(
        handles=lines,
        loc="upper right",
        fontsize=size,
        facecolor=GROUND,
        edgecolor=FAINT,
        labelcolor=INK,
    )
