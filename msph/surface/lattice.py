"""The rectilinear node lattice on which the surface is found: node (i, j, k) at (x_i, y_j, z_k)."""

import math

import numpy as np

# Rows of a pair along x and y, and nodes of a run along z: 2 x 2 runs are evaluated together.
PAIR, RUN = 2, 4
# In a walled lattice the wall nodes stand off the wall by about this part of the spacing: no
# triangle at a box edge loses all its area, and the offset is far too small to be seen.
INSET = 2.0**-10


class Lattice:
    """Coordinates [m] of the nodes along each axis.

    walled: the outermost nodes of each axis are ghosts behind a wall, taken to be outside; the
    surface between them and their neighbours is put on the wall plane, halfway.
    """

    def __init__(self, axes: list[np.ndarray], walled: bool = False):
        self.axes = [np.asarray(a, dtype=np.float32) for a in axes]
        self.shape = tuple(len(a) for a in self.axes)
        self.walled = walled
        # Nodes in whole pairs of rows and whole runs.
        tile = (PAIR, PAIR, RUN)
        self.padded = tuple(e * -(-n // e) for n, e in zip(self.shape, tile, strict=True))

    @classmethod
    def uniform(cls, shape, spacing=(1.0, 1.0, 1.0), origin=(0.0, 0.0, 0.0)) -> "Lattice":
        """Nodes at origin + spacing * index; spacing may differ between axes."""
        triples = zip(shape, spacing, origin, strict=True)
        return cls([o + s * np.arange(n) for n, s, o in triples])

    @classmethod
    def in_box(cls, size: tuple[float, float, float], cell: float) -> "Lattice":
        """Walled lattice over the box (0, 0, 0) to size [m], spacing close to `cell` [m]."""
        return cls([walled_axis(length, cell) for length in size], walled=True)

    def rows(self) -> list[np.ndarray]:
        """The axes [m], each prolonged by its last node to the longest padded one."""
        longest = max(self.padded)
        return [np.pad(a, (0, longest - len(a)), mode="edge") for a in self.axes]

    @property
    def spacing(self) -> tuple[float, float, float]:
        """Widest distance between neighbouring nodes along each axis [m]."""
        sx, sy, sz = (float(np.diff(a).max()) for a in self.axes)
        return sx, sy, sz


def intervals(length: float, cell: float) -> int:
    """Lattice intervals along a wall-to-wall axis: even, as the band's samples need."""
    return 2 * max(1, round(0.5 * length / cell))


def walled_axis(length: float, cell: float) -> np.ndarray:
    """Node coordinates of one axis: ghost, wall node, interior nodes, wall node, ghost.

    Ghost and wall node mirror each other. Their distance from the wall is a power of two, so both
    sums, and the plane halfway, are exact in f32.
    """
    n = intervals(length, cell)
    inset = 2.0 ** round(math.log2(INSET * length / n))
    x = np.linspace(0.0, length, n + 1)
    wall = float(np.float32(length))
    return np.concatenate([[-inset, inset], x[1:-1], [wall - inset, wall + inset]])
