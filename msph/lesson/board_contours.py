"""Board of marching squares and cubes: contours at a threshold, ambiguous cells, and holes."""

from itertools import pairwise
from typing import ClassVar

import numpy as np
from scipy.ndimage import label

from msph.lesson import chart
from msph.lesson.boards import Input
from msph.surface import cube_tables

# Numbers on a grid, similar to the thesis's figure 4.3: two ponds with a saddle between them.
NUMBERS = np.array(
    [
        [1, 2, 1, 1, 2, 1, 1],
        [2, 7, 6, 2, 3, 2, 1],
        [1, 8, 9, 6, 3, 4, 2],
        [2, 4, 6, 3, 6, 7, 3],
        [1, 2, 4, 4, 8, 9, 2],
        [1, 1, 2, 3, 7, 6, 2],
        [1, 1, 1, 2, 2, 1, 1],
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
RULES = ("each cube by itself", "by the shared face")


class Board:
    """Left a grid of numbers with its contours, right the meshes of two adjacent cubes."""

    INPUTS: ClassVar[dict[str, Input]] = {
        "threshold": Input("-", 5.0, 0.0, 9.0),
        "diagonal": Input("-", 0.0, 0.0, 1.0),
        "rule": Input("-", 1.0, 0.0, 1.0),
    }
    NUMBERS: ClassVar[dict[str, str]] = {"ponds": "-", "ambiguous": "-", "open_edges": "-"}

    def numbers(self, values: dict[str, float]) -> dict[str, float]:
        """Returns the number of ponds (connected water on the grid), of ambiguous cells (opposite
        water corners), and of interior mesh edges with one triangle only."""
        inside = _inside(values)
        corners = np.ones((3, 3)) if values["diagonal"] > 0.5 else None
        return {
            "ponds": float(label(inside, corners)[1]),
            "ambiguous": float(len(_ambiguous(inside))),
            "open_edges": float(len(open_edges(pair_mesh(values["rule"] > 0.5)))),
        }

    def draw(self, values: dict[str, float], size: tuple[int, int]) -> np.ndarray:
        drawing, (left, right) = chart.figure(size, (1, 1), flat=False)
        inside = _inside(values)
        rows, columns = NUMBERS.shape
        for i, j in _ambiguous(inside):
            left.fill([j, j + 1, j + 1, j], [i, i, i + 1, i + 1], color=chart.COLOURS[4], alpha=0.3)
        for i in range(rows):
            for j in range(columns):
                colour = chart.COLOURS[0] if inside[i, j] else chart.FAINT
                style = {"color": colour, "ha": "center", "va": "center"}
                left.text(j, i, f"{NUMBERS[i, j]:.0f}", fontsize=left.title.get_size(), **style)
        for line in contour(values["threshold"] + OFFSET, values["diagonal"] > 0.5):
            left.plot(*zip(*line, strict=True), color=chart.COLOURS[1], lw=3)
        left.set(xticks=(), yticks=(), aspect="equal", xlim=(-0.5, columns - 0.5))
        left.set_ylim(rows - 0.5, -0.5)
        numbers = self.numbers(values)
        left.set_title(
            f"threshold {values['threshold']:g}: ponds {numbers['ponds']:.0f}, "
            f"ambiguous cells {numbers['ambiguous']:.0f}"
        )
        self._draw_pair(right, values["rule"] > 0.5)
        right.set_title(f"{RULES[round(values['rule'])]}: {numbers['open_edges']:.0f} open edges")
        return chart.finish(drawing)

    @staticmethod
    def _draw_pair(ax, by_face: bool) -> None:
        """Draws two cubes with their corners and triangles, and open edges in red."""
        from mpl_toolkits.mplot3d.art3d import Poly3DCollection

        for i in range(3):
            for a in range(2):
                for b in range(2):
                    wet = PAIR[i, a, b]
                    ax.scatter(i, a, b, s=70, color=chart.COLOURS[0] if wet else chart.FAINT)
        for a in range(2):
            for b in range(2):
                ax.plot([0, 2], [a, a], [b, b], color=chart.FAINT, lw=1)
        for i in range(3):
            ring = [(0, 0), (1, 0), (1, 1), (0, 1), (0, 0)]
            ax.plot([i] * 5, *zip(*ring, strict=True), color=chart.FAINT, lw=1)
        triangles = pair_mesh(by_face)
        ax.add_collection3d(
            Poly3DCollection(triangles, alpha=0.55, facecolor=chart.COLOURS[2], edgecolor=chart.INK)
        )
        for edge in open_edges(triangles):
            ax.plot(*zip(*edge, strict=True), color=chart.RED, lw=5)
        ax.set(xlim=(0, 2), ylim=(0, 1), zlim=(0, 1))
        ax.set_box_aspect((2, 1, 1), zoom=0.95)
        ax.view_init(elev=24, azim=-58)
        ax.set_axis_off()


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
    corners, as in our tables; otherwise a cube with more water than air uses the triangles of its
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
    count: dict[frozenset, int] = {}
    for triangle in triangles:
        ring = [tuple(corner.tolist()) for corner in triangle]
        for p, q in pairwise([*ring, ring[0]]):
            edge = frozenset((p, q))
            count[edge] = count.get(edge, 0) + 1
    single = [tuple(edge) for edge, number in count.items() if number == 1]
    return [edge for edge in single if not _outside(*edge)]


def _outside(p: tuple, q: tuple) -> bool:
    return any(
        p[axis] == q[axis] == end
        for axis, ends in enumerate(((0, 2), (0, 1), (0, 1)))
        for end in ends
    )
