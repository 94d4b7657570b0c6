"""Rectilinear lattice on which the surface is found: node (i, j, k) is at (x_i, y_j, z_k)."""

import math

import numpy as np

# Rows of a pair along x and y, and nodes of a run along z: 2 x 2 runs are evaluated together.
PAIR, RUN = 2, 4
# Approximate distance of wall nodes from the wall, in spacings: too small to see, and large enough
# that triangles at box edges keep an area.
INSET = 2.0**-10


class Lattice:
    """Coordinates [m] of the nodes along each axis.

    walled: the outermost nodes of each axis are ghosts outside the walls, always outside the water;
    the surface between a ghost and its neighbour is placed on the wall, halfway between them.
    """

    def __init__(self, axes: list[np.ndarray], walled: bool = False):
        self.axes = [np.asarray(a, dtype=np.float32) for a in axes]
        self.shape = tuple(len(a) for a in self.axes)
        self.walled = walled
        # Number of nodes rounded up to whole pairs of rows and whole runs.
        tile = (PAIR, PAIR, RUN)
        self.padded = tuple(e * -(-n // e) for n, e in zip(self.shape, tile, strict=True))

    @classmethod
    def in_box(cls, size: tuple[float, float, float], cell: float) -> "Lattice":
        """Returns a walled lattice over the box from 0 to size [m] with a spacing close to `cell`
        [m]."""
        return cls([walled_axis(length, cell) for length in size], walled=True)

    def rows(self) -> list[np.ndarray]:
        """Returns the axes [m], each padded with its last node to the longest padded axis."""
        longest = max(self.padded)
        return [np.pad(a, (0, longest - len(a)), mode="edge") for a in self.axes]

    @property
    def spacing(self) -> tuple[float, float, float]:
        """Largest distance between neighbouring nodes along each axis [m]."""
        sx, sy, sz = (float(np.diff(a).max()) for a in self.axes)
        return sx, sy, sz


def walled_axis(length: float, cell: float) -> np.ndarray:
    """Returns the coordinates of one axis: ghost, wall node, interior nodes, wall node, ghost.
    Ghost and wall node are at equal distances from the wall: a power of two, so that both
    coordinates, and the plane halfway, are exact in f32."""
    n = 2 * max(1, round(0.5 * length / cell))  # even, for samples at every second node
    inset = 2.0 ** round(math.log2(INSET * length / n))
    x = np.linspace(0.0, length, n + 1)
    wall = float(np.float32(length))
    return np.concatenate([[-inset, inset], x[1:-1], [wall - inset, wall + inset]])
