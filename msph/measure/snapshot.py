"""Snapshot of the water on the host, read by probes and surveys.

A probe reads only the particles near it, without a kernel or a device field of its own.
"""

import dataclasses
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from msph.fluid.simulation import Simulation
from msph.measure.host_kernels import coverage, mirrored, wendland

# Coverage at the water's surface, over the share of the kernel outside bodies: half of the kernel
# is in the water there, images included.
SURFACE_COVERAGE = 0.5
# Sample points across a kernel for its share outside bodies, good to 1 %; even, so that no plane of
# points lies on the face of a body at the kernel's centre.
SAMPLES_ACROSS = 12
# Depth in a body, in spacings, within which points still count as on its faces.
FACE_TOLERANCE = 0.1
# Coverage of dry and of fully wet points; symmetric about SURFACE_COVERAGE, so that sums over faces
# do not depend on where a flat surface lies between two points.
DRY_COVERAGE, WET_COVERAGE = 0.1, 0.9
# Number of points evaluated together.
CHUNK = 64
# Radius of the fit, in supports h_j: with 1, four particles would remain for the four unknowns in a
# corner, where seven eighths of the kernel are empty.
FIT_RADIUS = 1.5
# Regularisation of the slope in the fit, in squared radii: bounds slopes that the particles do not
# determine, as across a single layer. It costs 0.4 % of rho g d at a wall.
SLOPE_WEIGHT = 1e-4


@dataclass(frozen=True)
class Snapshot:
    """Particles in the box at one time [s] as host arrays of length n: x (n, 3) [m], pressure [Pa]
    or None before the first step, spacing and support [m], v (n, 3) [m/s]; size (3,) [m] of the
    box, or of the region with an open top; free(points, margin) returns which points (p, 3) [m] are
    `margin` [m] outside all bodies; bodies: True if there are any; poses: displacement [m] and
    rotation of each since time zero."""

    x: np.ndarray
    pressure: np.ndarray | None
    spacing: np.ndarray
    support: np.ndarray
    size: tuple[float, float, float]
    free: Callable[[np.ndarray, float], np.ndarray]
    bodies: bool = False
    v: np.ndarray | None = None
    time: float = 0.0
    poses: tuple[tuple[np.ndarray, np.ndarray], ...] = ()

    @classmethod
    def of(cls, simulation: Simulation) -> "Snapshot":
        p, specs = simulation.particles, simulation.layers.specs
        x, boundary = p.numpy("x").astype(float), simulation.boundary
        # Without particles in pipes and jets beyond the walls, which the walls must not mirror.
        inside = np.all((x >= 0.0) & (x <= simulation.walls), axis=1)
        layer = p.numpy("layer")[inside]
        return cls(
            x[inside],
            p.numpy("pressure")[inside].astype(float) if simulation.steps else None,
            np.array([s.spacing for s in specs])[layer],
            np.array([s.support for s in specs])[layer],
            simulation.region,
            boundary.free,
            boundary.count > 0,
            p.numpy("v")[inside].astype(float),
            simulation.reached,
            tuple(boundary.pose(k) for k in range(boundary.count)),
        )

    @property
    def volume(self) -> float:
        """Volume of the water at rest density [m^3]."""
        return float((self.spacing**3).sum())

    def near(self, lo: np.ndarray, hi: np.ndarray) -> "Snapshot":
        """Returns the particles needed by fits at points between lo and hi (3,) [m]."""
        reach = FIT_RADIUS * self.support.max(initial=0.0)
        kept = np.all((self.x > lo - reach) & (self.x < hi + reach), axis=1)
        own = ("x", "pressure", "spacing", "support", "v")
        parts = {k: None if getattr(self, k) is None else getattr(self, k)[kept] for k in own}
        return dataclasses.replace(self, **parts)

    def at(self, point: np.ndarray, name: str) -> np.ndarray:
        """Returns an attribute at a point (3,) [m] in the water or on a wall; NaN in air and inside
        bodies.

        Moving least squares of first order with weights V_j W(r_j, 1.5 h_j) (Lancaster and
        Salkauskas 1981): exact for linear fields at any particle positions, so that the pressure on
        a wall is not the pressure of the first particles, half a spacing away.
        """
        around = self.near(point, point)
        values = getattr(around, name)
        close = np.linalg.norm(around.x - point, axis=1) < FIT_RADIUS * around.support
        if around.coverage(point[None], close, FIT_RADIUS)[0] < SURFACE_COVERAGE:
            return np.full(values.shape[1:], np.nan)
        return around._plane(point, values)

    def _plane(self, point: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Returns the fit of values (n, ...) at a point (3,) [m] with particles near it."""
        distance, reach = np.linalg.norm(self.x - point, axis=1), FIT_RADIUS * self.support
        close = distance < reach
        h = reach[close]
        weight = self.spacing[close] ** 3 * wendland(distance[close], h)
        basis = np.column_stack([np.ones(len(h)), (self.x[close] - point) / h.max()])
        moments = basis.T @ (weight[:, None] * basis)
        moments[range(1, 4), range(1, 4)] += SLOPE_WEIGHT * weight.sum()
        weighed = (weight * values[close].T).T
        return np.linalg.solve(moments, basis.T @ weighed)[0]

    def wetted(self, points: np.ndarray, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Returns the wet share (-) of points (p, 3) [m], (p,), and an attribute there, (p, ...), 0
        at dry points: for sums over faces."""
        values = getattr(self, name)
        wet, found = np.zeros(len(points)), np.zeros((len(points), *values.shape[1:]))
        # Near bodies about half of the kernel is empty, so a wider kernel is used.
        for first, around, c in self._chunks(points, FIT_RADIUS if self.bodies else 1.0):
            share = (c - DRY_COVERAGE) / (WET_COVERAGE - DRY_COVERAGE)
            wet[first : first + CHUNK] = np.clip(share, 0.0, 1.0)
            for k in np.flatnonzero(c > DRY_COVERAGE):
                found[first + k] = around._plane(points[first + k], getattr(around, name))
        return wet, found

    def coverages(self, points: np.ndarray) -> np.ndarray:
        """Returns the coverage (p,) of points (p, 3) [m] by all particles; see coverage()."""
        return np.concatenate([c for _, _, c in self._chunks(points, 1.0)])

    def _chunks(
        self, points: np.ndarray, widen: float
    ) -> Iterator[tuple[int, "Snapshot", np.ndarray]]:
        """Yields, for CHUNK points after another, the index of the first, the particles near them,
        and their coverage."""
        for first in range(0, len(points), CHUNK):
            some = points[first : first + CHUNK]
            around = self.near(some.min(axis=0), some.max(axis=0))
            yield first, around, around.coverage(some, np.ones(len(around.x), bool), widen)

    def pressures(self, points: np.ndarray) -> np.ndarray:
        """Returns the pressures (p,) [Pa] at points (p, 3) [m]; NaN in air, inside bodies and
        before the first step."""
        if self.pressure is None:
            return np.full(len(points), np.nan)
        return np.array([self.at(point, "pressure") for point in points])

    def coverage(self, points: np.ndarray, close: np.ndarray, widen: float = 1.0) -> np.ndarray:
        """Returns the coverage (p,) of points (p, 3) [m] by particles `close`, (n,) bool, and their
        images, with kernels of radius widen * h_j, over the share of the kernel outside bodies; 0
        inside bodies."""
        reach = widen * self.support[close]
        x, which = mirrored(self.x[close], self.size, reach.max(initial=0.0))
        c = coverage(points, x, self.spacing[close][which] ** 3, reach[which])
        if self.bodies and close.any():
            nearest = np.linalg.norm(points[:, None] - self.x[close], axis=2).argmin(axis=1)
            depth = FACE_TOLERANCE * self.spacing[close].min()
            share = np.maximum(self._share(points, reach[nearest]), 1.0 / SAMPLES_ACROSS**3)
            c = np.where(self.free(points, -depth), c / share, 0.0)
        return c

    def _share(self, points: np.ndarray, reach: np.ndarray) -> np.ndarray:
        """Returns the share (p,) outside bodies of kernels of radius reach (p,) [m] at points
        (p, 3) [m]; walls mirror the bodies."""
        axis = (np.arange(SAMPLES_ACROSS) + 0.5) / SAMPLES_ACROSS * 2.0 - 1.0
        ball = np.stack(np.meshgrid(axis, axis, axis), axis=-1).reshape(-1, 3)
        weight = wendland(np.linalg.norm(ball, axis=1), 1.0)
        ball, weight = ball[weight > 0.0], weight[weight > 0.0]
        size = np.array(self.size)
        places = np.abs(points[:, None] + reach[:, None, None] * ball)
        places = size - np.abs(size - places)
        outside = self.free(places.reshape(-1, 3), 0.0).reshape(len(points), -1)
        return (weight * outside).sum(axis=1) / weight.sum()
