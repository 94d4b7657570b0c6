"""Surveys: measurements of volume and densities from positions, too slow for every frame."""

from dataclasses import dataclass

import numpy as np

from msph.measure.bulk import BulkDensity, bulk_density
from msph.measure.kernel_density import KernelDensity, kernel_density
from msph.measure.snapshot import Snapshot

# Column heads of Survey.row().
COLUMNS = [
    "volume [m^3]",
    "kernel_density_error_mean [-]",
    "kernel_density_error_p99 [-]",
    "bulk_density_mean [-]",
    "bulk_density_least [-]",
    "bulk_density_most [-]",
]


@dataclass(frozen=True)
class Survey:
    """A survey at a time [s]: volume [m^3] within the surface mesh, its error relative to the
    volume at rest density (-), kernel density error (-), bulk density over rest (-), and the reason
    for missing volume, if the surface gives one."""

    time: float
    volume: float
    volume_error: float
    kernel: KernelDensity
    bulk: BulkDensity
    shortfall: str | None = None

    def row(self) -> list[float]:
        kernel, bulk = self.kernel, self.bulk
        return [self.volume, kernel.mean, kernel.p99, bulk.mean, bulk.least, bulk.most]


def survey(time: float, volume: float, water: Snapshot, shortfall: str | None = None) -> Survey:
    """Returns the survey of water whose surface mesh encloses `volume` [m^3]."""
    bulk = bulk_density(water.x, water.spacing, water.size, water.free)
    kernel = kernel_density(water.x, water.spacing, water.size)
    return Survey(time, volume, volume / water.volume - 1.0, kernel, bulk, shortfall)


def shortfall(surveys: list[Survey]) -> str | None:
    """Returns the reason for missing volume in the survey with the largest error, or None."""
    overflowed = [s for s in surveys if np.isnan(s.volume_error)]
    known = [s for s in surveys if np.isfinite(s.volume_error)]
    worst = overflowed or sorted(known, key=lambda s: abs(s.volume_error))[-1:]
    return worst[0].shortfall if worst else None


def errors(surveys: list[Survey]) -> dict[str, float]:
    """Returns the mean, last and worst errors of volume and bulk density, and the means over time
    of the kernel density error's mean and 99th percentile (-), NaN if unknown."""
    found = {
        f"kernel_density_error_{name}": float(np.mean([getattr(s.kernel, name) for s in surveys]))
        if surveys
        else np.nan
        for name in ("mean", "p99")
    }
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
