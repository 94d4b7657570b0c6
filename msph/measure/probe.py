"""Base class of probes, and the lattice of points on a rectangle."""

from abc import ABC, abstractmethod

import numpy as np

from msph.measure.snapshot import Snapshot


class Probe(ABC):
    """A named probe: reads quantities of the water at a place."""

    name: str

    @property
    @abstractmethod
    def heads(self) -> list[str]:
        """Column heads "name [unit]" of the numbers that read() returns."""

    @abstractmethod
    def read(self, water: Snapshot) -> list[float]:
        """Returns the readings in SI units, NaN if unknown."""

    def resume(self, last: list[float]) -> None:  # noqa: B027 -- most probes have no state
        """Restores the probe's state from its last readings when a run is resumed."""


def lattice(lo: np.ndarray, hi: np.ndarray, spacing: float) -> tuple[np.ndarray, float]:
    """Returns the centres (p, 3) [m] of cells at most `spacing` [m] wide that divide the rectangle
    from lo to hi [m], and a cell's area [m^2]."""
    edges = hi - lo
    counts = np.maximum(1, np.ceil(edges / spacing - 1e-6)).astype(int)
    axes = [a + (np.arange(n) + 0.5) * e / n for a, e, n in zip(lo, edges, counts, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    return points, float(np.prod(edges[edges > 0.0])) / len(points)
