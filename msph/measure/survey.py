"""Surveys: the water's volume and bulk density, measures too dear for every frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from msph.measure.snapshot import Snapshot

if TYPE_CHECKING:
    from msph.measure.bulk import BulkDensity

# Heads of the columns that Survey.row() fills.
COLUMNS = [
    "volume [m^3]",
    "bulk_density_mean [-]",
    "bulk_density_least [-]",
    "bulk_density_most [-]",
]


@dataclass(frozen=True)
class Survey:
    """time [s]; volume [m^3] that the surface encloses and its share of the water's volume at rest
    density, less one (-); bulk density, over rest (-); shortfall: why volume is missing, in words,
    where the surface knows."""

    time: float
    volume: float
    volume_error: float
    bulk: BulkDensity
    shortfall: str | None = None

    def row(self) -> list[float]:
        return [self.volume, self.bulk.mean, self.bulk.least, self.bulk.most]


def survey(time: float, volume: float, water: Snapshot, shortfall: str | None = None) -> Survey:
    """Surveys the water whose surface encloses `volume` [m^3], and lacks some for `shortfall`."""
    # Here, since only surveys need scipy, which takes .2 s to import.
    from msph.measure.bulk import bulk_density

    rest = float((water.spacing**3).sum())
    bulk = bulk_density(water.x, water.spacing, water.size, water.free)
    return Survey(time, volume, volume / rest - 1.0, bulk, shortfall)


def shortfall(surveys: list[Survey]) -> str | None:
    """Why the survey with the largest error of volume lacks it, in words; None if unknown."""
    overflowed = [s for s in surveys if np.isnan(s.volume_error)]
    known = [s for s in surveys if np.isfinite(s.volume_error)]
    worst = overflowed or sorted(known, key=lambda s: abs(s.volume_error))[-1:]
    return worst[0].shortfall if worst else None


def errors(surveys: list[Survey]) -> dict[str, float]:
    """Mean, last and worst errors of volume and bulk density over a run (-); NaN if unknown."""
    found = {}
    for name, values in (
        ("volume_error", [s.volume_error for s in surveys]),
        ("bulk_density_error", [s.bulk.mean - 1.0 for s in surveys]),
    ):
        known = np.array([v for v in values if np.isfinite(v)])
        some = len(known) > 0
        found[f"{name}_mean"] = float(known.mean()) if some else np.nan
        found[f"{name}_last"] = float(known[-1]) if some else np.nan
        found[f"{name}_worst"] = float(known[np.abs(known).argmax()]) if some else np.nan
    return found
