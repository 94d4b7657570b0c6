"""Surveys: measurements of volume and densities from positions, too slow for every frame."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from msph.measure.bulk import bulk_density
from msph.measure.entry import Record
from msph.measure.kernel_density import kernel_density
from msph.measure.snapshot import Snapshot


@dataclass(frozen=True)
class Survey(Record):
    """A survey of the water: volume within the surface mesh, kernel density error, bulk density
    over rest; volume_error: over the volume at rest density (-); shortfall: reason for missing
    volume, if the surface gives one."""

    volume: Annotated[float, "m^3"]
    kernel_density_error_mean: Annotated[float, "-"]
    kernel_density_error_p99: Annotated[float, "-"]
    bulk_density_mean: Annotated[float, "-"]
    bulk_density_least: Annotated[float, "-"]
    bulk_density_most: Annotated[float, "-"]
    volume_error: float
    shortfall: str | None = None

    @property
    def bulk_density_error(self) -> float:
        return self.bulk_density_mean - 1.0


def survey(volume: float, water: Snapshot, shortfall: str | None = None) -> Survey:
    """Returns the survey of water whose surface mesh encloses `volume` [m^3]."""
    kernel = kernel_density(water.x, water.spacing, water.size)
    bulk = bulk_density(water.x, water.spacing, water.size, water.free)
    densities = kernel.mean, kernel.p99, bulk.mean, bulk.least, bulk.most
    return Survey(volume, *densities, volume / water.volume - 1.0, shortfall)


def surveys_of(rows: np.ndarray, mass: np.ndarray, rest_density: float) -> list[Survey]:
    """Returns the surveys of rows (n, columns), NaN without a survey, of water with a mass (n,)
    [kg] and a rest density [kg/m^3]."""
    errors = rows[:, 0] * rest_density / mass - 1.0
    made = np.isfinite(rows).any(axis=1)
    return [Survey.of(*each) for each in zip(rows[made], errors[made], strict=True)]


def shortfall(surveys: list[Survey]) -> str | None:
    """Returns the reason for missing volume in the survey with the largest error, or None."""
    overflowed = [s for s in surveys if np.isnan(s.volume_error)]
    known = [s for s in surveys if np.isfinite(s.volume_error)]
    worst = overflowed or sorted(known, key=lambda s: abs(s.volume_error))[-1:]
    return worst[0].shortfall if worst else None


def errors(surveys: list[Survey]) -> dict[str, float]:
    """Returns the mean, last and worst errors of volume and bulk density, and the means over time
    of the kernel density error's mean and 99th percentile (-), NaN if unknown."""
    found = {}
    for name in ("kernel_density_error_mean", "kernel_density_error_p99"):
        found[name] = float(np.mean([getattr(s, name) for s in surveys] or [np.nan]))
    for name in ("volume_error", "bulk_density_error"):
        values = [getattr(s, name) for s in surveys]
        known = [float(v) for v in values if np.isfinite(v)] or [np.nan]
        found[f"{name}_mean"] = float(np.mean(known))
        found[f"{name}_last"] = known[-1]
        found[f"{name}_worst"] = max(known, key=abs)
    return found
