"""What a probe is, and the lattice of points on a face that several read."""

from abc import ABC, abstractmethod

import numpy as np

from msph.measure.snapshot import Snapshot


class Probe(ABC):
    """An instrument with a name."""

    name: str

    @property
    @abstractmethod
    def heads(self) -> list[str]:
        """ "name [unit]" of each number that read() gives."""

    @abstractmethod
    def read(self, water: Snapshot) -> list[float]:
        """In SI units, NaN for what is not known."""

    def go_on(self, last: list[float]) -> None:  # noqa: B027 -- most have nothing to take up
        """Takes up from what it read last: a run is resumed."""


def lattice(lo: np.ndarray, hi: np.ndarray, spacing: float) -> tuple[np.ndarray, float]:
    """Middles (p, 3) [m] of the cells, at most `spacing` [m] wide, of the rectangle from lo to hi
    [m], and a cell's area [m^2]; a point where they are the same."""
    edges = hi - lo
    counts = np.maximum(1, np.ceil(edges / spacing - 1e-6)).astype(int)
    axes = [a + (np.arange(n) + 0.5) * e / n for a, e, n in zip(lo, edges, counts, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    return points, float(np.prod(edges[edges > 0.0])) / len(points)
