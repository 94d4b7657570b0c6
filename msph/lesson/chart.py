"""Style of boards: colours, text size, figures and their pixels."""

from typing import Any

import numpy as np

from msph.lesson.typeset import pyplot

# Colours on a dark background, distinguishable with colour blindness (Okabe and Ito 2008).
GROUND, INK, FAINT = "#0a141e", "#f5f7fa", "#8aa4b4"
COLOURS = ("#56b4e9", "#e69f00", "#009e73", "#cc79a7", "#f0e442")
RED = "#ff6b5e"
DPI = 100
# Text height over the image's, and least text height [pixels].
TEXT, MIN_TEXT = 1.0 / 28.0, 18


def figure(size: tuple[int, int], panels: tuple[int, ...] = (1, 1), flat: bool = True) -> Any:
    """Returns a figure of size (width, height) [pixels] and its axes side by side, with relative
    widths `panels`; flat: False gives the last axes a third dimension."""
    plt = pyplot()
    points = 0.72 * max(MIN_TEXT, TEXT * size[1])
    style = {
        "font.size": points,
        "axes.facecolor": GROUND,
        "figure.facecolor": GROUND,
        "text.color": INK,
        "axes.labelcolor": INK,
        "xtick.color": FAINT,
        "ytick.color": FAINT,
        "axes.edgecolor": FAINT,
        "axes.titlesize": points,
        "figure.constrained_layout.use": True,
    }
    with plt.rc_context(style):
        drawing = plt.figure(figsize=(size[0] / DPI, size[1] / DPI), dpi=DPI)
        grid = drawing.add_gridspec(1, len(panels), width_ratios=panels)
        last = len(panels) - 1
        axes = [
            drawing.add_subplot(grid[0, k], projection=None if flat or k < last else "3d")
            for k in range(len(panels))
        ]
        for ax in axes:
            ax.tick_params(labelsize=points)
    return drawing, axes


def legend(ax: Any) -> None:
    """Adds a legend in the upper right corner."""
    size = ax.xaxis.label.get_size()
    ax.legend(loc="upper right", fontsize=size, facecolor=GROUND, edgecolor=FAINT, labelcolor=INK)


def finish(drawing: Any) -> np.ndarray:
    """Closes a figure and returns its pixels (height, width, 3) uint8, first row at the top."""
    drawing.canvas.draw()
    pixels = np.asarray(drawing.canvas.buffer_rgba())[..., :3].copy()
    pyplot().close(drawing)
    return pixels
