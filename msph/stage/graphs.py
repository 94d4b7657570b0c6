"""Graphs of the last seconds: stage times, real-time factor, solver residual, energy, particles."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from msph.stage.sheet import DENSE, FAINT, INK, Sheet, font_of
from msph.stage.show import Show

# Time span of the graphs [s], and time between two samples [s].
SPAN, EVERY = 10.0, 0.2
# Colours of the curves, distinguishable with colour blindness (Okabe and Ito 2008).
COLOURS = ((86, 180, 233), (230, 159, 0), (0, 158, 115), (240, 228, 66), (204, 121, 167))
# Title height and gap between graphs [text heights]; width of curves [pixels].
TITLE, GAP, STROKE = 1.3, 0.35, 2


@dataclass(frozen=True)
class Graph:
    """A graph. title: quantity and unit; sample: values of the curves, from the show and the
    real-time factor; form: of a value; names: of the curves, empty for none."""

    title: str
    sample: Callable[[Show, float], list[float]]
    form: str = "{:.0f}"
    names: tuple[str, ...] = ()


def _stages(show: Show, _: float) -> list[float]:
    frame = show.timings.frames[-1] if show.timings.frames else {}
    return [1e3 * frame.get(name, 0.0) for name in ("fluid", "surface", "picture")]


def _counts(show: Show, _: float) -> list[float]:
    return [float(n) for n in show.state.counts()]


GRAPHS = (
    Graph("frame [ms]", _stages, names=("fluid", "surface", "image")),
    Graph("real-time factor [-]", lambda show, pace: [pace], "{:.2f}"),
    Graph("solver residual [%]", lambda show, _: [100.0 * show.now.solver_residual], "{:.3f}"),
    Graph("energy [J]", lambda show, _: [show.now.energy], "{:.1f}"),
    Graph("particles", _counts),
)


class Graphs:
    """Graphs with the samples of the last SPAN seconds."""

    def __init__(self) -> None:
        self.times: deque[float] = deque()
        self.samples: deque[list[list[float]]] = deque()

    def observe(self, show: Show, now: float, pace: float) -> None:
        """Takes a sample at the wall-clock time `now` [s] if it is due."""
        if self.times and now - self.times[-1] < EVERY:
            return
        self.times.append(now)
        self.samples.append([graph.sample(show, pace) for graph in GRAPHS])
        while now - self.times[0] > SPAN:
            self.times.popleft()
            self.samples.popleft()

    def paint(self, size: tuple[int, int], text: int) -> Sheet:
        """Returns a page of size (width, height) [pixels] with all graphs; text: text height
        [pixels]."""
        sheet, (width, height) = Sheet(size, text, DENSE), size
        draw, font = sheet.draw, sheet.font
        pad, each = round(0.5 * text), height / len(GRAPHS)
        x = (np.array(self.times) - self.times[-1]) / SPAN + 1.0
        for k, graph in enumerate(GRAPHS):
            top, bottom = k * each + TITLE * text, (k + 1) * each - GAP * text
            curves = np.array([sample[k] for sample in self.samples]).T
            draw.text((pad, top), graph.title, INK, font, anchor="ls")
            room = width - 3 * pad - font.getlength(graph.title)
            self._legend(draw, graph, curves[:, -1], (width - pad, top), room, text)
            known = curves[np.isfinite(curves)]
            lo, hi = (known.min(), known.max()) if known.size else (0.0, 1.0)
            # The energy's axis need not contain 0: only changes of the energy matter.
            lo = lo if graph.title.startswith("energy") else min(lo, 0.0)
            span = max(hi - lo, 1e-9)
            draw.line((pad, bottom, width - pad, bottom), FAINT)
            for curve, colour in zip(curves, COLOURS * 3, strict=False):
                y = bottom - (curve - lo) / span * (bottom - top - 0.4 * text)
                points = [(pad + a * (width - 2 * pad), b) for a, b in zip(x, y, strict=True)]
                points = [p for p in points if np.isfinite(p[1])]
                if len(points) > 1:
                    draw.line(points, colour, STROKE)
        return sheet

    @staticmethod
    def _legend(draw, graph: Graph, last, corner, room: float, size: int) -> None:
        """Draws names and last values in the colours of their curves. They end at `corner`, (right,
        base) [pixels], and have the text height `size` [pixels], or less if `room` is narrower."""
        texts = [graph.form.format(value) if np.isfinite(value) else "-" for value in last]
        if graph.names:
            texts = [f"{name} {text}" for name, text in zip(graph.names, texts, strict=True)]
        needed = font_of(size).getlength("  ".join(texts))
        font = font_of(int(size * min(1.0, room / needed)))
        right, base = corner
        for text, colour in reversed(list(zip(texts, COLOURS * 3, strict=False))):
            draw.text((right, base), text, colour, font, anchor="rs")
            right -= font.getlength(text + "  ")
