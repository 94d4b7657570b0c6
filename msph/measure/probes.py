"""Probes: instruments that read a Snapshot of the water, a number or three each.

NaN, an empty cell of the table, is what a probe reads where there is no water: in air, inside of a
body, over a dry floor; and of pressures before the first step.
"""

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from msph.measure.probe import Probe, lattice
from msph.measure.snapshot import SURFACE, Snapshot
from msph.scene.schema import Scene

# Height is sought in steps of this many finest spacings.
HEIGHT_STEP = 0.1
AXES = {"x": 0, "y": 1, "z": 2}


@dataclass
class PressureProbe(Probe):
    """Pressure [Pa] at the point lo [m], in the water or on a wall or a body; or if hi is another,
    its mean over the rectangle between, a sensor's face, of which dry parts bear none.

    window [s]: of the sensor's sampling, the mean of the readings within which is read. A front
    that meets a wall is pressed for single steps, many times as hard as for long; impulses tell.
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
    """Height [m] of the water over the floor at `at` (x, z) [m]: the highest place where coverage
    falls through one half. A lone particle in the open never covers a half."""

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
        wet = np.flatnonzero(c >= SURFACE)
        if len(wet) == 0:
            return [np.nan]
        k = wet[-1]
        if k == len(y) - 1:
            return [float(top)]
        return [float(y[k] + (y[k + 1] - y[k]) * (c[k] - SURFACE) / (c[k] - c[k + 1]))]


@dataclass
class FrontProbe(Probe):
    """Farthest coordinate [m] that the bulk of the water has reached along `axis`, such as "+x" or
    "-z". It does not step back: where a tongue breaks off, the bulk ends behind for some frames.

    The bulk is the largest connected body: cells of the coarsest spacing that hold particles and
    touch, also at corners. Spray that flies ahead of it with air between does not count, a sheet of
    one particle's thickness does. Half a spacing of water lies beyond the last centre.
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
        # Here, since only fronts need it: it takes .1 s to import.
        from scipy.ndimage import label

        body = label(full, np.ones((3, 3, 3)))[0][cell]
        largest = np.bincount(body, weights=water.spacing**3).argmax()
        bulk, k = body == largest, AXES[self.axis[1]]
        sign = 1.0 if self.axis[0] == "+" else -1.0
        farthest = sign * (sign * water.x[bulk, k] + 0.5 * water.spacing[bulk]).max()
        now = float(np.clip(farthest, 0.0, water.size[k])) + 0.0  # no minus zero
        ahead = np.fmax if sign > 0.0 else np.fmin
        self.reached = float(ahead(self.reached, now))
        return [self.reached]

    def go_on(self, last: list[float]) -> None:
        (self.reached,) = last


def build_probes(scene: Scene) -> list[Probe]:
    """The scene's probes, in its order; the scene must have been checked."""
    # Here, since trimesh is slow to import.
    from msph.measure.face_probes import FluxProbe, ForceProbe

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
