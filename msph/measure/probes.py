"""Probes at points, columns, fronts, faces and bodies, which read a Snapshot of the water.

A reading is NaN, an empty cell of the table, where there is no water: in air, inside a body, over a
dry floor.
"""

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from msph.fluid.boundary.body_faces import samples
from msph.fluid.boundary.rigid_bodies import centre
from msph.measure.snapshot import SURFACE_COVERAGE, Snapshot
from msph.scene import schema
from msph.scene.bodies import bodies, number_of
from msph.scene.schema import Scene
from msph.scene.water import layer_specs

# Step of the search for the height, in finest spacings.
HEIGHT_STEP = 0.1
# Largest edge of a body's faces, in finest spacings, and most faces; each is read alone.
MAX_EDGE, MAX_FACES = 0.75, 8000
AXES = {"x": 0, "y": 1, "z": 2}


class Probe(ABC):
    """A named probe. HEADS: "name [unit]" of each number read, with {} for the probe's name.
    PRESSURE: True if it reads pressures."""

    HEADS: ClassVar[tuple[str, ...]]
    PRESSURE: ClassVar[bool] = False
    name: str

    @property
    def heads(self) -> list[str]:
        """Column heads "name [unit]" of the numbers that read() returns."""
        return [head.format(self.name) for head in self.HEADS]

    @abstractmethod
    def read(self, water: Snapshot) -> list[float]:
        """Returns the readings in SI units, NaN if unknown."""

    def resume(self, last: list[float]) -> None:  # noqa: B027 -- most probes have no state
        """Restores the probe's state from its last readings when a run is resumed."""


@dataclass
class PressureProbe(Probe):
    """Pressure [Pa] at the point lo [m], in the water or on a wall or a body; with hi, the mean
    over the rectangle from lo to hi.

    window [s]: averaging time of the readings. In an impact on a wall the pressure peaks for single
    steps, so only its average is meaningful. In means over a rectangle or a time dry readings count
    as zero.
    """

    HEADS, PRESSURE = ("{} [Pa]",), True
    name: str
    lo: tuple[float, float, float]
    hi: tuple[float, float, float] | None = None
    window: float = 0.0
    past: deque[tuple[float, float]] = field(default_factory=deque)

    def read(self, water: Snapshot) -> list[float]:
        if water.pressure is None:
            return [np.nan]
        lo = np.array(self.lo)
        if self.hi is None:
            now = float(water.at(lo, "pressure"))
            if self.window > 0.0 and np.isnan(now):
                now = 0.0
        else:
            points, _ = lattice(lo, np.array(self.hi), water.spacing.min())
            wet, pressures = water.wetted(points, "pressure")
            now = float((wet * pressures).mean())
        self.past.append((water.time, now))
        while self.past[0][0] <= water.time - self.window and len(self.past) > 1:
            self.past.popleft()
        return [float(np.mean([p for _, p in self.past]))]


@dataclass
class VelocityProbe(Probe):
    """Velocity [m/s] of the water at `point` [m]."""

    HEADS = ("{}_x [m/s]", "{}_y [m/s]", "{}_z [m/s]")
    name: str
    point: tuple[float, float, float]

    def read(self, water: Snapshot) -> list[float]:
        return water.at(np.array(self.point), "v").tolist()


@dataclass
class HeightProbe(Probe):
    """Height [m] of the water above the floor at `at` (x, z) [m]: the highest point where coverage
    falls below one half, which single particles of spray never reach."""

    HEADS = ("{} [m]",)
    name: str
    at: tuple[float, float]

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

    HEADS = ("{} [m]",)
    name: str
    axis: str
    reached: float = np.nan

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


@dataclass
class FluxProbe(Probe):
    """Volume flux [m^3/s] along an axis through a rectangle from lo to hi [m] normal to it."""

    HEADS = ("{} [m^3/s]",)
    name: str
    lo: tuple[float, float, float]
    hi: tuple[float, float, float]

    def read(self, water: Snapshot) -> list[float]:
        lo, hi = np.array(self.lo), np.array(self.hi)
        axis = int(np.argmin(hi - lo))
        points, area = lattice(lo, hi, water.spacing.min())
        wet, velocity = water.wetted(points, "v")
        return [float(area * (wet * velocity[:, axis]).sum()) if wet.any() else np.nan]


@dataclass
class ForceProbe(Probe):
    """Force [N] of the water on body number `body`, the integral of the pressure over its wet
    faces, and torque [N m] about its centre, in the box's frame.

    At time zero: centre (3,) [m] of the body; middles (f, 3) [m] of its faces, relative to this
    centre; areas (f, 3) [m^2]: area vectors of the faces, towards the water.
    """

    HEADS = (
        *("{}_force_x [N]", "{}_force_y [N]", "{}_force_z [N]"),
        *("{}_torque_x [N m]", "{}_torque_y [N m]", "{}_torque_z [N m]"),
    )
    PRESSURE = True
    name: str
    body: int
    centre: np.ndarray
    middles: np.ndarray
    areas: np.ndarray

    @classmethod
    def of(cls, name: str, scene: Scene, body: str) -> "ForceProbe":
        """Returns the probe of a body by its name or key in the scene: container, bodies.0, ..."""
        number = number_of(scene, body)
        shape = bodies(scene)[number]
        edge = MAX_EDGE * min(s.spacing for s in layer_specs(scene))
        points, areas = samples(shape, edge, MAX_FACES)
        return cls(name, number, centre(shape), points, areas)

    def read(self, water: Snapshot) -> list[float]:
        if water.pressure is None:
            return [np.nan] * 6
        offset, turn = water.poses[self.body]
        arms = self.middles @ turn.T
        points = self.centre + offset + arms
        inside = np.all((points >= 0.0) & (points <= np.array(water.size)), axis=1)
        pressures = np.zeros(len(points))
        wet, found = water.wetted(points[inside], "pressure")
        pressures[inside] = wet * found
        forces = -pressures[:, None] * (self.areas @ turn.T)
        return [*forces.sum(axis=0).tolist(), *np.cross(arms, forces).sum(axis=0).tolist()]


def lattice(lo: np.ndarray, hi: np.ndarray, spacing: float) -> tuple[np.ndarray, float]:
    """Returns the centres (p, 3) [m] of cells at most `spacing` [m] wide that divide the rectangle
    from lo to hi [m], and a cell's area [m^2]."""
    edges = hi - lo
    counts = np.maximum(1, np.ceil(edges / spacing - 1e-6)).astype(int)
    axes = [a + (np.arange(n) + 0.5) * e / n for a, e, n in zip(lo, edges, counts, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    return points, float(np.prod(edges[edges > 0.0])) / len(points)


# Constructors of the probes by kind, from a checked probe of a scene.
KINDS: dict[str, Callable[[schema.Probe, Scene], Probe]] = {
    "pressure": lambda p, _: PressureProbe(p.name, p.point or p.lo, p.hi, p.window),
    "velocity": lambda p, _: VelocityProbe(p.name, p.point),
    "height": lambda p, _: HeightProbe(p.name, p.at),
    "front": lambda p, _: FrontProbe(p.name, p.axis),
    "flux": lambda p, _: FluxProbe(p.name, p.lo, p.hi),
    "force": lambda p, scene: ForceProbe.of(p.name, scene, p.body),
}


def build_probes(scene: Scene) -> list[Probe]:
    """Returns the probes of a checked scene, in its order."""
    return [KINDS[probe.kind](probe, scene) for probe in scene.probes]
