"""The water at one time, on the host: what probes and surveys look at.

A probe looks at the few particles near it: no time step waits for it, and nothing is compiled or
allocated for it.
"""

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from msph.fluid.simulation import Simulation
from msph.measure.host_kernels import coverage, mirrored, wendland

# Coverage at which water ends, over the share of the kernel that bodies leave: half of the kernel's
# ball is water there, images included.
SURFACE = 0.5
# Points of a lattice along the diameter of a kernel's ball by which that share is found, to 1 %: an
# even number, since a sheet of points on the face of a body is in it or not by rounding.
ACROSS = 12
# Depth in a body, in spacings, from which on a place is none for water; a mesh is sampled, and what
# lies on its faces should be read.
BURIED = 0.1
# Coverage from which on a place holds any water, and all of it: even about SURFACE, so that faces
# are wet up to a flat surface wherever it lies between two points.
SOME, ALL = 0.1, 0.9
# Points that are looked at together.
CHUNK = 64
# Radius of the pressure fit, in supports h_j. At a wall half of the ball is empty, in a corner
# seven eighths: with h alone four particles would be left there for four unknowns.
FIT_RADIUS = 1.5
# Weight of "no slope" in the fit, in squared radii: bounds a slope across which the particles tell
# nothing, as in a sheet of one layer. It costs .4 % of rho g d at a wall.
RIDGE = 1e-4


@dataclass(frozen=True)
class Snapshot:
    """Particles at one time [s], host arrays of length n: x (n, 3) [m], pressure [Pa] or None while
    no solver has run, spacing and support [m], v (n, 3) [m/s]; size (3,) [m] of the box;
    free(points, margin) tells which points (p, 3) [m] are `margin` [m] outside of all bodies, if
    there are `bodies`; poses: way [m] and rotation of each since time zero."""

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
        layer, boundary = p.numpy("layer"), simulation.boundary
        return cls(
            p.numpy("x").astype(float),
            p.numpy("pressure").astype(float) if simulation.steps else None,
            np.array([s.spacing for s in specs])[layer],
            np.array([s.support for s in specs])[layer],
            simulation.size,
            boundary.free,
            boundary.count > 0,
            p.numpy("v").astype(float),
            simulation.time,
            tuple(boundary.pose(k) for k in range(boundary.count)),
        )

    def near(self, lo: np.ndarray, hi: np.ndarray) -> "Snapshot":
        """The particles that fits at points between lo and hi (3,) [m] may need."""
        reach = FIT_RADIUS * self.support.max(initial=0.0)
        kept = np.all((self.x > lo - reach) & (self.x < hi + reach), axis=1)
        own = ("x", "pressure", "spacing", "support", "v")
        parts = {k: None if getattr(self, k) is None else getattr(self, k)[kept] for k in own}
        return dataclasses.replace(self, **parts)

    def at(self, point: np.ndarray, name: str) -> np.ndarray:
        """The attribute of that name at a point (3,) [m] in the water or on its walls; NaN in air
        and inside of bodies.

        Moving least squares of first order: the plane that fits best the values around, each
        weighed by V_j W(r_j, 1.5 h_j) (Lancaster & Salkauskas 1981). Exact for linear fields
        whatever the particles' places, so a wall reads the hydrostatic pressure of the wall and not
        of the first layer of particles, half a spacing off.
        """
        around = self.near(point, point)
        values = getattr(around, name)
        close = np.linalg.norm(around.x - point, axis=1) < FIT_RADIUS * around.support
        if around.coverage(point[None], close, FIT_RADIUS)[0] < SURFACE:
            return np.full(values.shape[1:], np.nan)
        return around._plane(point, values)

    def _plane(self, point: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Of values (n, ...) the fit at a point, wet or not; some particle must be near."""
        distance, reach = np.linalg.norm(self.x - point, axis=1), FIT_RADIUS * self.support
        close = distance < reach
        h = reach[close]
        weight = self.spacing[close] ** 3 * wendland(distance[close], h)
        basis = np.column_stack([np.ones(len(h)), (self.x[close] - point) / h.max()])
        moments = basis.T @ (weight[:, None] * basis)
        moments[range(1, 4), range(1, 4)] += RIDGE * weight.sum()
        weighed = (weight * values[close].T).T
        return np.linalg.solve(moments, basis.T @ weighed)[0]

    def wetted(self, points: np.ndarray, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Share (p,) of points (p, 3) [m] that is in the water (-), and the attribute of that name
        there, (p, ...), 0 where all is dry: for sums over faces."""
        values = getattr(self, name)
        wet, found = np.zeros(len(points)), np.zeros((len(points), *values.shape[1:]))
        for first in range(0, len(points), CHUNK):
            some = points[first : first + CHUNK]
            around = self.near(some.min(axis=0), some.max(axis=0))
            # Where half of a kernel is in a body, the other half alone is too rough.
            widen = FIT_RADIUS if self.bodies else 1.0
            c = around.coverage(some, np.ones(len(around.x), bool), widen)
            wet[first : first + CHUNK] = np.clip((c - SOME) / (ALL - SOME), 0.0, 1.0)
            for k in np.flatnonzero(c > SOME):
                found[first + k] = around._plane(some[k], getattr(around, name))
        return wet, found

    def pressures(self, points: np.ndarray) -> np.ndarray:
        """At points (p, 3) [m], (p,) [Pa]; NaN in air and inside of bodies, or before a step."""
        if self.pressure is None:
            return np.full(len(points), np.nan)
        return np.array([self.at(point, "pressure") for point in points])

    def coverage(self, points: np.ndarray, close: np.ndarray, widen: float = 1.0) -> np.ndarray:
        """c (p,) at points (p, 3) [m] by those particles that are `close`, (n,) bool, and their
        images, with kernels of radius widen * h_j; over the share of the kernel outside of bodies,
        and 0 inside of them."""
        reach = widen * self.support[close]
        x, which = mirrored(self.x[close], self.size, reach.max(initial=0.0))
        c = coverage(points, x, self.spacing[close][which] ** 3, reach[which])
        if self.bodies and close.any():
            nearest = np.linalg.norm(points[:, None] - self.x[close], axis=2).argmin(axis=1)
            depth = BURIED * self.spacing[close].min()
            room = np.maximum(self._room(points, reach[nearest]), 1.0 / ACROSS**3)
            c = np.where(self.free(points, -depth), c / room, 0.0)
        return c

    def _room(self, points: np.ndarray, reach: np.ndarray) -> np.ndarray:
        """Share (p,) of kernels of radius reach (p,) [m] round points (p, 3) [m] that lies outside
        of bodies, what is behind walls being a mirror's image."""
        axis = (np.arange(ACROSS) + 0.5) / ACROSS * 2.0 - 1.0
        ball = np.stack(np.meshgrid(axis, axis, axis), axis=-1).reshape(-1, 3)
        weight = wendland(np.linalg.norm(ball, axis=1), 1.0)
        ball, weight = ball[weight > 0.0], weight[weight > 0.0]
        size = np.array(self.size)
        places = np.abs(points[:, None] + reach[:, None, None] * ball)
        places = size - np.abs(size - places)
        outside = self.free(places.reshape(-1, 3), 0.0).reshape(len(points), -1)
        return (weight * outside).sum(axis=1) / weight.sum()
