"""Probes: pressure at a point, water height over a point of the floor, position of a front.

A probe reads a Snapshot of the water. It looks at the few particles near it, on the host: no time
step waits for it, and nothing is compiled or allocated for it.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from msph.fluid.simulation import Simulation
from msph.measure.host_kernels import coverage, mirrored, wendland
from msph.scene.schema import Scene

# Coverage at which water ends, over the share of the kernel that bodies leave: half of the kernel's
# ball is water there, images included.
SURFACE = 0.5
# Points of a lattice along the diameter of a kernel's ball by which that share is found: to 1 %.
ACROSS = 11
# Depth in a body, in spacings, from which on a place is none for water; a mesh is sampled, and what
# lies on its faces should be read.
BURIED = 0.1
# Radius of the pressure fit, in supports h_j. At a wall half of the ball is empty, in a corner
# seven eighths: with h alone four particles would be left there for four unknowns.
FIT_RADIUS = 1.5
# Weight of "no slope" in the fit, in squared radii: bounds a slope across which the particles tell
# nothing, as in a sheet of one layer. It costs .4 % of rho g d at a wall.
RIDGE = 1e-4
# Height is sought in steps of this many finest spacings.
HEIGHT_STEP = 0.1
AXES = {"x": 0, "y": 1, "z": 2}


@dataclass(frozen=True)
class Snapshot:
    """Particles at one time, host arrays of length n: x (n, 3) [m], pressure [Pa] or None while no
    solver has run, spacing and support [m]; size (3,) [m] of the box; free(points, margin) tells
    which points (p, 3) [m] are `margin` [m] outside of all bodies, if there are `bodies`."""

    x: np.ndarray
    pressure: np.ndarray | None
    spacing: np.ndarray
    support: np.ndarray
    size: tuple[float, float, float]
    free: Callable[[np.ndarray, float], np.ndarray]
    bodies: bool = False

    @classmethod
    def of(cls, simulation: Simulation) -> "Snapshot":
        p, specs = simulation.particles, simulation.layers.specs
        layer = p.numpy("layer")
        return cls(
            p.numpy("x").astype(float),
            p.numpy("pressure").astype(float) if simulation.steps else None,
            np.array([s.spacing for s in specs])[layer],
            np.array([s.support for s in specs])[layer],
            simulation.size,
            simulation.boundary.free,
            simulation.boundary.count > 0,
        )

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


@dataclass(frozen=True)
class PressureProbe:
    """Pressure [Pa] at `point` [m], in the water or on a wall or a body; 0 in air and inside of
    bodies, NaN before the first step.

    Moving least squares of first order: the plane that fits best the pressures around, each weighed
    by V_j W(r_j, 1.5 h_j) (Lancaster & Salkauskas 1981). Exact for linear fields whatever the
    particles' places, so a wall reads the hydrostatic pressure of the wall and not of the first
    layer of particles, half a spacing off.
    """

    name: str
    point: tuple[float, float, float]
    unit = "Pa"

    def read(self, water: Snapshot) -> float:
        if water.pressure is None:
            return float("nan")
        point = np.array(self.point)
        distance, reach = np.linalg.norm(water.x - point, axis=1), FIT_RADIUS * water.support
        close = distance < reach
        if water.coverage(point[None], close, FIT_RADIUS)[0] < SURFACE:
            return 0.0
        h = reach[close]
        weight = water.spacing[close] ** 3 * wendland(distance[close], h)
        scale = h.max()
        basis = np.column_stack([np.ones(len(h)), (water.x[close] - point) / scale])
        moments = basis.T @ (weight[:, None] * basis)
        moments[range(1, 4), range(1, 4)] += RIDGE * weight.sum()
        fit = np.linalg.solve(moments, basis.T @ (weight * water.pressure[close]))
        return float(fit[0])


@dataclass(frozen=True)
class HeightProbe:
    """Height [m] of the water over the floor at `at` (x, z) [m]: the highest place where coverage
    falls through one half; 0 where there is no water. A lone particle in the open never covers a
    half."""

    name: str
    at: tuple[float, float]
    unit = "m"

    def read(self, water: Snapshot) -> float:
        x, z = self.at
        close = np.hypot(water.x[:, 0] - x, water.x[:, 2] - z) < water.support
        if not close.any():
            return 0.0
        step = HEIGHT_STEP * water.spacing[close].min()
        top = min((water.x[:, 1] + water.support)[close].max(), water.size[1])
        y = np.linspace(0.0, top, int(np.ceil(top / step)) + 1)
        c = water.coverage(np.stack([np.full_like(y, x), y, np.full_like(y, z)], axis=1), close)
        wet = np.flatnonzero(c >= SURFACE)
        if len(wet) == 0:
            return 0.0
        k = wet[-1]
        if k == len(y) - 1:
            return float(top)
        return float(y[k] + (y[k + 1] - y[k]) * (c[k] - SURFACE) / (c[k] - c[k + 1]))


@dataclass(frozen=True)
class FrontProbe:
    """Farthest coordinate [m] of the bulk of the water along `axis`, such as "+x" or "-z".

    The bulk is the largest connected body: cells of the coarsest spacing that hold particles and
    touch, also at corners. Spray that flies ahead of it with air between does not count, a sheet of
    one particle's thickness does. Half a spacing of water lies beyond the last centre.
    """

    name: str
    axis: str
    unit = "m"

    def read(self, water: Snapshot) -> float:
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
        farthest = (sign * water.x[bulk, k] + 0.5 * water.spacing[bulk]).max()
        return float(np.clip(sign * farthest, 0.0, water.size[k])) + 0.0  # no minus zero


Probe = PressureProbe | HeightProbe | FrontProbe


def build_probes(scene: Scene) -> list[Probe]:
    """The scene's probes, in its order; the scene must have been checked."""
    built: list[Probe] = []
    for p in scene.probes:
        if p.point is not None:
            built.append(PressureProbe(p.name, p.point))
        elif p.at is not None:
            built.append(HeightProbe(p.name, p.at))
        elif p.axis is not None:
            built.append(FrontProbe(p.name, p.axis))
    return built
