"""Style of boards: colours, text size, and a figure that is drawn many times."""

from collections.abc import Callable
from typing import Any

import numpy as np

from msph.lesson.typeset import pyplot

# Colours on a dark background, distinguishable with colour blindness (Okabe and Ito 2008).
GROUND, INK, FAINT = "#0a141e", "#f5f7fa", "#8aa4b4"
COLOURS = ("#56b4e9", "#e69f00", "#009e73", "#cc79a7", "#f0e442")
RED = "#ff6b5e"
DPI = 100
# Text height over image height, and least text height [pixels].
TEXT, MIN_TEXT = 1.0 / 28.0, 18


class Chart:
    """Figure with axes side by side, of relative widths `panels`; flat: False gives the last axes a
    third dimension.

    Layout and ticks take most of the time of a drawing, so they are found once per size. prepare
    is called with the axes before the layout, and draws the parts that all images share.
    """

    def __init__(
        self,
        prepare: Callable[[list[Any]], None],
        panels: tuple[int, ...] = (1, 1),
        flat: bool = True,
    ):
        self.prepare, self.panels, self.flat = prepare, panels, flat
        self.size: tuple[int, int] | None = None
        self.drawing: Any = None
        self.common: list[set[Any]] = []  # artists of each axes that all images share

    def begin(self, size: tuple[int, int]) -> list[Any]:
        """Returns the axes of an image of size (width, height) [pixels], without the artists that
        were added to the last image."""
        if size != self.size:
            with pyplot().rc_context(style(size)):
                self._build(size)
        for ax, common in zip(self.drawing.axes, self.common, strict=True):
            for artist in set(ax.get_children()) - common:
                artist.remove()
        return self.drawing.axes

    def finish(self) -> np.ndarray:
        """Returns the image (height, width, 3) uint8, first row at the top."""
        self.drawing.canvas.draw()
        return np.asarray(self.drawing.canvas.buffer_rgba())[..., :3].copy()

    def _build(self, size: tuple[int, int]) -> None:
        plt = pyplot()
        if self.drawing is not None:
            plt.close(self.drawing)
        self.size = size
        self.drawing = plt.figure(figsize=(size[0] / DPI, size[1] / DPI), dpi=DPI)
        grid = self.drawing.add_gridspec(1, len(self.panels), width_ratios=self.panels)
        last = len(self.panels) - 1
        for k in range(len(self.panels)):
            kind = None if self.flat or k < last else "3d"
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
