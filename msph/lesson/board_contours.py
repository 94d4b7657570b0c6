"""Board of marching squares and cubes: contours at a threshold, ambiguous cells, and holes."""

from collections import Counter
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np
from scipy.ndimage import label

from msph.lesson import chart
from msph.lesson.boards import Input, choice
from msph.surface import cube_tables

# Numbers on a grid, rows from the top: figure 4.3 of the thesis, which uses the threshold 5.
NUMBERS = np.array(
    [
        [0, 1, 3, 2, 2],
        [2, 4, 5, 8, 4],
        [3, 6, 7, 9, 3],
        [1, 7, 6, 9, 3],
        [1, 4, 3, 4, 2],
    ],
    float,
)
# Offset of thresholds from whole numbers, so that no number equals a threshold.
OFFSET = 1e-3
# Water at the corners (i, j, k) of two cubes; the water corners of their shared face are opposite.
PAIR = np.array(
    [[[1, 1], [1, 1]], [[1, 0], [0, 1]], [[0, 0], [0, 0]]],
    bool,
)
# Rules for the water corners of an ambiguous cell, and for an ambiguous face.
DIAGONALS, RULES = ("separate", "joined"), ("own cube", "shared face")
# Area of a drawn corner of the cubes [points^2].
CORNER = 70


class Board(chart.Board):
    """Diagram of a number grid with contours (left) and meshes of two adjacent cubes (right)."""

    INPUTS: ClassVar[dict[str, Input]] = {
        "threshold": Input("-", 5.0, 0.0, 9.0),
        "diagonal": choice(DIAGONALS),
        "rule": choice(RULES, 1),
    }
    NUMBERS: ClassVar[dict[str, str]] = {"ponds": "-", "ambiguous": "-", "open_edges": "-"}
    SOLID = True

    def numbers(self, values: dict[str, float]) -> dict[str, float]:
        """Returns the number of ponds (connected water on the grid), of ambiguous cells (opposite
        water corners), and of interior mesh edges with one triangle only."""
        inside = _inside(values)
        corners = np.ones((3, 3)) if values["diagonal"] > 1.5 else None
        return {
            "ponds": float(label(inside, corners)[1]),
            "ambiguous": float(len(_ambiguous(inside))),
            "open_edges": float(len(open_edges(pair_mesh(values["rule"] > 1.5)))),
        }

    def prepare(self, axes: list[Any]) -> None:
        """Draws two cubes with their corners."""
        from mpl_toolkits.mplot3d.art3d import Line3DCollection

        left, right = axes
        rows, columns = NUMBERS.shape
        left.set(xticks=(), yticks=(), aspect="equal", xlim=(-0.5, columns - 0.5))
        left.set_ylim(rows - 0.5, -0.5)
        colours = [chart.COLOURS[0] if wet else chart.FAINT for wet in PAIR.ravel()]
        places = np.indices(PAIR.shape).reshape(3, -1)
        right.scatter(*places, s=CORNER, c=colours, depthshade=False)
        corners = list(np.ndindex(PAIR.shape))
        near = ((p, q, np.abs(np.subtract(q, p)).sum()) for p in corners for q in corners if p < q)
        edges = [(p, q) for p, q, apart in near if apart == 1]
        right.add_collection3d(Line3DCollection(edges, colors=chart.FAINT, linewidths=1))
        right.set(xlim=(0, 2), ylim=(0, 1), zlim=(0, 1))
        right.set_box_aspect((2, 1, 1), zoom=0.95)
        right.view_init(elev=24, azim=-58)
        right.set_axis_off()

    def paint(self, axes: list[Any], values: dict[str, float]) -> None:
        left, right = axes
        inside = _inside(values)
        rows, columns = NUMBERS.shape
        for i, j in _ambiguous(inside):
            left.fill([j, j + 1, j + 1, j], [i, i, i + 1, i + 1], color=chart.COLOURS[4], alpha=0.3)
        for i in range(rows):
            for j in range(columns):
                colour = chart.COLOURS[0] if inside[i, j] else chart.FAINT
                style = {"color": colour, "ha": "center", "va": "center"}
                left.text(j, i, f"{NUMBERS[i, j]:.0f}", fontsize=left.title.get_size(), **style)
        for line in contour(values["threshold"] + OFFSET, values["diagonal"] > 1.5):
            left.plot(*zip(*line, strict=True), color=chart.COLOURS[1], lw=3)
        numbers = self.numbers(values)
        left.set_title(
            f"threshold {values['threshold']:g}: ponds {numbers['ponds']:.0f}, "
            f"ambiguous cells {numbers['ambiguous']:.0f}"
        )
        by_face = values["rule"] > 1.5
        self._draw_pair(right, by_face)
        right.set_title(f"rule: {RULES[by_face]}, {numbers['open_edges']:.0f} open edges")

    @staticmethod
    def _draw_pair(ax, by_face: bool) -> None:
        """Draws the triangles of two cubes, and open edges in red."""
        from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

        triangles = pair_mesh(by_face)
        ax.add_collection3d(
            Poly3DCollection(triangles, alpha=0.55, facecolor=chart.COLOURS[2], edgecolor=chart.INK)
        )
        if single := open_edges(triangles):
            ax.add_collection3d(Line3DCollection(single, colors=chart.RED, linewidths=5))


def _inside(values: dict[str, float]) -> np.ndarray:
    return values["threshold"] + OFFSET < NUMBERS


def _ambiguous(inside: np.ndarray) -> list[tuple[int, int]]:
    """Returns the cells (row, column) whose two water corners are opposite."""
    a, b = inside[:-1, :-1], inside[:-1, 1:]
    c, d = inside[1:, 1:], inside[1:, :-1]
    rows, columns = np.nonzero((a == c) & (b == d) & (a != b))
    return list(zip(rows.tolist(), columns.tolist(), strict=True))


def contour(threshold: float, diagonal: bool) -> list[list[tuple[float, float]]]:
    """Returns the segments of the contour at a threshold, ends (column, row), by linear
    interpolation. diagonal: True if an ambiguous cell connects its water corners."""
    segments = []
    for i in range(NUMBERS.shape[0] - 1):
        for j in range(NUMBERS.shape[1] - 1):
            ring = [(i, j), (i, j + 1), (i + 1, j + 1), (i + 1, j)]
            cuts = {}
            for k, (p, q) in enumerate(pairwise([*ring, ring[0]])):
                u, v = NUMBERS[p], NUMBERS[q]
                if (u > threshold) != (v > threshold):
                    t = (threshold - u) / (v - u)
                    cuts[k] = (p[1] + t * (q[1] - p[1]), p[0] + t * (q[0] - p[0]))
            if len(cuts) == 2:
                segments.append(list(cuts.values()))
            elif len(cuts) == 4:
                # Corner k is between the cuts on edges k - 1 and k.
                wet = NUMBERS[ring[0]] > threshold
                first = 0 if wet != diagonal else 1
                segments += [[cuts[(k - 1) % 4], cuts[k]] for k in (first, first + 2)]
    return segments


def pair_mesh(by_face: bool) -> list[np.ndarray]:
    """Returns the triangles (3, 3) of both cubes. by_face: an ambiguous face separates its water
    corners, as in cube_tables; otherwise a cube with more water than air uses the triangles of its
    complement, as in the 15 cases of Lorensen and Cline (1987)."""
    found = []
    for i in range(2):
        corners = cube_tables.CORNERS + np.array((i, 0, 0))
        wet = np.array([PAIR[tuple(corner)] for corner in corners])
        flip = not by_face and wet.sum() > 4
        case = int(((~wet if flip else wet) << np.arange(8)).sum())
        middle = corners[cube_tables.EDGES].mean(axis=1)
        for k in range(cube_tables.TRIANGLE_COUNTS[case]):
            triangle = middle[cube_tables.TRIANGLES[case, k]]
            found.append(triangle[::-1] if flip else triangle)
    return found


def open_edges(triangles: list[np.ndarray]) -> list[tuple]:
    """Returns the edges with one triangle only, except those on the outside of the two cubes."""
    rings = [[tuple(corner.tolist()) for corner in triangle] for triangle in triangles]
    count = Counter(frozenset(edge) for ring in rings for edge in pairwise([*ring, ring[0]]))
    return [tuple(edge) for edge, number in count.items() if number == 1 and not _outside(*edge)]


def _outside(p: tuple, q: tuple) -> bool:
    walls = ((0, 2), (0, 1), (0, 1))
    return any(a == b and a in ends for a, b, ends in zip(p, q, walls, strict=True))
