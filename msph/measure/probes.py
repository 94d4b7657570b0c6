"""Probes at points, columns and fronts, which read a Snapshot of the water.

A reading is NaN, an empty cell of the table, where there is no water: in air, inside a body, over a
dry floor; pressures are NaN before the first step.
"""

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from msph.measure.probe import Probe, lattice
from msph.measure.snapshot import SURFACE_COVERAGE, Snapshot
from msph.scene.schema import Scene

# Step of the search for the height, in finest spacings.
HEIGHT_STEP = 0.1
AXES = {"x": 0, "y": 1, "z": 2}


@dataclass
class PressureProbe(Probe):
    """Pressure [Pa] at the point lo [m], in the water or on a wall or a body; with hi, the mean
    over the rectangle from lo to hi, where dry parts count as zero.

    window [s]: averaging time of the readings. In an impact on a wall the pressure peaks for single
    steps, so only its average is meaningful.
    """

    name: str
    lo: tuple[float, float, float]
    hi: tuple[float, float, float] | None = None
    window: float = 0.0
    past: deque[tuple[float, float]] = field(default_factory=deque)

    @property
    def heads(self) -> list[str]:
        return [f"{self.name} [Pa]"]

    def read(self, water: Snapshot) -> list[float]:
        if water.pressure is None:
            return [np.nan]
        lo = np.array(self.lo)
        if self.hi is None:
            now = float(water.at(lo, "pressure"))
        else:
            points, _ = lattice(lo, np.array(self.hi), water.spacing.min())
            wet, pressures = water.wetted(points, "pressure")
            now = float((wet * pressures).mean()) if wet.any() else np.nan
        self.past.append((water.time, now))
        while self.past[0][0] <= water.time - self.window and len(self.past) > 1:
            self.past.popleft()
        known = [p for _, p in self.past if np.isfinite(p)]
        return [float(np.mean(known)) if known else np.nan]


@dataclass
class VelocityProbe(Probe):
    """Velocity [m/s] of the water at `point` [m]."""

    name: str
    point: tuple[float, float, float]

    @property
    def heads(self) -> list[str]:
        return [f"{self.name}_{k} [m/s]" for k in "xyz"]

    def read(self, water: Snapshot) -> list[float]:
        return water.at(np.array(self.point), "v").tolist()


@dataclass
class HeightProbe(Probe):
    """Height [m] of the water above the floor at `at` (x, z) [m]: the highest point where coverage
    falls below one half, which single particles of spray never reach."""

    name: str
    at: tuple[float, float]

    @property
    def heads(self) -> list[str]:
        return [f"{self.name} [m]"]

    def read(self, water: Snapshot) -> list[float]:
        x, z = self.at
        close = np.hypot(water.x[:, 0] - x, water.x[:, 2] - z) < water.support
        if not close.any():
            return [np.nan]
        step = HEIGHT_STEP * water.spacing[close].min()
        top = min((water.x[:, 1] + water.support)[close].max(), water.size[1])
        y = np.linspace(0.0, top, int(np.ceil(top / step)) + 1)
        c = water.coverage(np.stack([np.full_like(y, x), y, np.full_like(y, z)], axis=1), close)
        wet = np.flatnonzero(c >= SURFACE_COVERAGE)
        if len(wet) == 0:
            return [np.nan]
        k = wet[-1]
        if k == len(y) - 1:
            return [float(top)]
        return [float(y[k] + (y[k + 1] - y[k]) * (c[k] - SURFACE_COVERAGE) / (c[k] - c[k + 1]))]


@dataclass
class FrontProbe(Probe):
    """Farthest coordinate [m] that the bulk of the water has reached so far along `axis`, such as
    "+x" or "-z".

    The bulk is the largest set of connected cells that hold particles; cells have the coarsest
    spacing and connect also at corners, so detached spray is not part of it. The front is half a
    spacing beyond the last particle's centre.
    """

    name: str
    axis: str
    reached: float = np.nan

    @property
    def heads(self) -> list[str]:
        return [f"{self.name} [m]"]

    def read(self, water: Snapshot) -> list[float]:
        edge = water.spacing.max()
        cell = np.clip(water.x, 0.0, water.size) // edge
        cell = tuple(cell.astype(int).T)
        shape = [int(length // edge) + 1 for length in water.size]
        full = np.zeros(shape, dtype=bool)
        full[cell] = True
        from scipy.ndimage import label  # 0.1 s to import, and only fronts need it

        body = label(full, np.ones((3, 3, 3)))[0][cell]
        largest = np.bincount(body, weights=water.spacing**3).argmax()
        bulk, k = body == largest, AXES[self.axis[1]]
        sign = 1.0 if self.axis[0] == "+" else -1.0
        farthest = sign * (sign * water.x[bulk, k] + 0.5 * water.spacing[bulk]).max()
        now = float(np.clip(farthest, 0.0, water.size[k])) + 0.0  # turns -0.0 into 0.0
        ahead = np.fmax if sign > 0.0 else np.fmin
        self.reached = float(ahead(self.reached, now))
        return [self.reached]

    def resume(self, last: list[float]) -> None:
        (self.reached,) = last


def build_probes(scene: Scene) -> list[Probe]:
    """Returns the probes of a checked scene, in its order."""
    from msph.measure.face_probes import FluxProbe, ForceProbe  # imports trimesh, which is slow

    built: list[Probe] = []
    for p in scene.probes:
        if p.kind == "pressure":
            lo = p.point if p.lo is None else p.lo
            assert lo is not None
            built.append(PressureProbe(p.name, lo, p.hi, p.window))
        elif p.kind == "velocity" and p.point is not None:
            built.append(VelocityProbe(p.name, p.point))
        elif p.kind == "height" and p.at is not None:
            built.append(HeightProbe(p.name, p.at))
        elif p.kind == "front" and p.axis is not None:
            built.append(FrontProbe(p.name, p.axis))
        elif p.kind == "flux" and p.lo is not None and p.hi is not None:
            built.append(FluxProbe(p.name, p.lo, p.hi))
        elif p.kind == "force" and p.body is not None:
            built.append(ForceProbe.of(p.name, scene, p.body))
    return built
