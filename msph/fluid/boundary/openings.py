"""Openings: inflows, which add water, and outflows, which remove it.

An opening is a plane cross-section. Where it lies on a wall of the box, the wall neither mirrors
nor stops particles, and water beyond the wall is simulated over the length of a zone: in the pipe
of an inflow, or in the jet through a hole, up to where the jet is removed (rim.py).

An inflow prescribes the velocity of the particles in its zone. The pressure solve does not
displace them, so they act on other water like a piston, without gap or jump of pressure. An inflow
adds a sheet of particles at the far end of its zone each time the previous sheet has advanced by
the distance of sheets: n particles of volume V fill the cross-section A over the distance n V/A, so
that the flow is A times the speed.

An outflow with a speed is a pump behind a closed wall: it takes the particles nearest to its
cross-section at the rate of area times speed, as far as water is near.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import taichi as ti

from msph.fluid.boundary.apertures import Apertures
from msph.fluid.boundary.boundary import Boundary
from msph.fluid.constants import MAX_OPENINGS, Constants
from msph.fluid.impulse_ledger import ImpulseLedger
from msph.fluid.particles.layers import Layers, LayerSpec
from msph.fluid.particles.neighbour_list import NeighbourList
from msph.fluid.particles.particles import Attribute, Particles
from msph.taichi_internals import data_oriented, kernel

vec3 = ti.math.vec3

ATTRIBUTES = (
    Attribute(
        "prescribed",
        "-",
        "1 + index of the opening that prescribes the velocity, or 0",
        integer=True,
        carried=False,
    ),
)

# Length of a zone [spacings]: more than a support, so that no water feels the end of a pipe.
ZONE = 3.0
# By which a zone is wider than the opening [spacings], as rows of particles may overlap its edge.
SLACK = 0.5
# Greatest distance [spacings] of an opening from the wall on which it lies, and least cosine of
# the angle between its direction and the normal of that wall.
ON_WALL, ALONG_NORMAL = 0.5, 0.999
# Distance from a pump up to which it takes particles [spacings].
REACH = 1.5
# Distance of a new particle from others, in spacings, below which it is left out.
LEAST_GAP = 0.7
# Time [s] that no simulation reaches.
LAST = 1e12


@dataclass
class Valve:
    """A speed [m/s] until a time [s], and 0 from then on."""

    speed: float
    until: float = LAST

    def __call__(self, time: float) -> float:
        """Returns the speed [m/s] at a time [s]."""
        return self.speed if time < self.until else 0.0


@dataclass(frozen=True, eq=False)
class Opening:
    """Cross-section around `centre` (3,) [m] through which water flows along `direction` (3,): a
    disc of radius half[0] [m], or a rectangle of half edges `half` [m] along the rows of `edges`
    (2, 3).

    enters: True for an inflow. speed [m/s] over time [s]; None for an outflow that water leaves
    freely. layer: of new particles, or of most water around an outflow.
    """

    centre: np.ndarray
    direction: np.ndarray
    half: tuple[float, float]
    enters: bool
    speed: Callable[[float], float] | None = None
    edges: np.ndarray | None = None
    layer: int = 0

    @property
    def area(self) -> float:
        """Area of the cross-section [m^2]."""
        return math.pi * self.half[0] ** 2 if self.edges is None else 4.0 * math.prod(self.half)

    @property
    def along(self) -> np.ndarray:
        """Unit vector (3,) of the flow."""
        return self.direction / np.linalg.norm(self.direction)

    @property
    def frame(self) -> np.ndarray:
        """Unit vectors (2, 3) that span the cross-section."""
        if self.edges is not None:
            return self.edges
        across = np.cross(self.along, np.eye(3)[int(np.argmin(np.abs(self.along)))])
        across /= np.linalg.norm(across)
        return np.stack([across, np.cross(self.along, across)])

    def wall(self, walls: np.ndarray, spacing: float) -> int:
        """Returns the wall on which the opening lies and to which its flow is normal, as a bit
        (MirrorImages.walls_near), or 0. walls (3,) [m]: the far walls; spacing [m]: of its
        layer."""
        outwards = -self.along if self.enters else self.along
        for k in range(3):
            for far, wall in enumerate((0.0, walls[k])):
                near = abs(self.centre[k] - wall) < ON_WALL * spacing
                if near and (2 * far - 1) * outwards[k] > ALONG_NORMAL:
                    return 1 << (k + 3 * far)
        return 0

    def problem(self, walls: np.ndarray, spacing: float) -> str | None:
        """Returns a text if the opening, or its zone unless beyond a wall, is not inside the box.
        walls, spacing: as in wall()."""
        ends = [self.centre]
        if self.enters and not self.wall(walls, spacing):
            ends.append(self.centre - ZONE * spacing * self.along)
        spread = np.abs(self.frame).T @ self.half
        if self.edges is None:
            spread = self.half[0] * np.sqrt(1.0 - self.along**2)
        lo, hi = np.min(ends, axis=0) - spread, np.max(ends, axis=0) + spread
        edge = ON_WALL * spacing
        if np.all(lo >= -edge) and np.all(hi <= walls + edge):
            return None
        what = (
            f", {ZONE:g} spacings of {spacing:.3g} m behind it included," if len(ends) > 1 else ""
        )
        reach = " to ".join("(" + ", ".join(f"{c:.3g}" for c in x) + ")" for x in (lo, hi))
        return f"reaches{what} from {reach} m, beyond the box"

    def row(self, spec: LayerSpec, walls: np.ndarray) -> dict[str, Any]:
        """Returns the row of the table `constants.openings`."""
        length, wall = ZONE * spec.spacing, self.wall(walls, spec.spacing)
        if self.speed is None:
            # A jet contracts and gains speed over about the width of its hole.
            length += 2.0 * min(self.half)
        centre = self.centre.copy()
        if wall:
            # Exactly on the wall: the pipe and the box then meet without a gap.
            k = int(np.argmax(np.abs(self.along)))
            centre[k] = walls[k] if wall >= 8 else 0.0
        pumps = not self.enters and self.speed is not None
        return {
            "centre": centre,
            "along": self.along,
            "across": self.frame[0],
            "aslant": self.frame[1],
            "width": self.half[0],
            "height": self.half[1],
            "round": self.edges is None,
            "wall": 0 if pumps else wall,
            "zone_begin": -length if self.enters else 0.0,
            "zone_end": 0.0,
            "kept_from": -length - spec.spacing if self.enters else 0.0,
            "length": length + (2.0 * spec.spacing if self.enters else 0.0),
            "leaves": not self.enters and not pumps,
            "slack": SLACK * spec.spacing,
        }

    def sites(self, spec: LayerSpec) -> tuple[np.ndarray, float]:
        """Returns the sites (n, 3) [m] of a sheet relative to the centre, and the distance [m] of
        sheets."""
        d = spec.spacing
        if self.edges is None:
            # Rings: a square lattice would leave gaps at the edge.
            n, across = max(1, round(self.area / d**2)), self.half[0] / d
            found = [_rings(n, r) for r in {max(1, math.floor(across)), math.ceil(across)}]
            places = self.half[0] * max(found, key=_least_distance)
        else:
            axes = []
            for half in self.half:
                m = max(1, round(2.0 * half / d))
                axes.append(half * ((2.0 * np.arange(m) + 1.0) / m - 1.0))
            places = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
        return places @ self.frame, len(places) * spec.volume / self.area


def _rings(n: int, rings: int) -> np.ndarray:
    """Returns n points (n, 2) in the unit disc, evenly in rings of equal width."""
    ends = np.round(n * (np.arange(rings + 1) / rings) ** 2).astype(int)
    parts = []
    for ring, count in enumerate(np.diff(ends).tolist()):
        angle = 2.0 * np.pi * (np.arange(count) + 0.5 * ring) / max(count, 1)
        radius = (ring + 0.5) / rings * (count > 1)
        parts.append(radius * np.stack([np.cos(angle), np.sin(angle)], axis=1))
    return np.concatenate(parts)


def _least_distance(x: np.ndarray) -> float:
    """Returns the least distance between two of the points (n, 2)."""
    apart = np.linalg.norm(x[:, None] - x, axis=2) + np.where(np.eye(len(x)) > 0, np.inf, 0.0)
    return float(apart.min())


class Inlet:
    """Progress of an inflow: sites (n, 3) [m] of a sheet relative to the centre of the opening,
    distance [m] of sheets, and way [m] of the last sheet from the far end of the zone."""

    def __init__(self, opening: Opening, spec: LayerSpec):
        self.opening, self.spec = opening, spec
        self.sites, self.distance = opening.sites(spec)
        self.way = self.distance  # the first sheet is due at once


@data_oriented
class Openings:
    """The openings of a simulation, `all`. waiting: inflows for whose next sheet the pool has no
    room; waited [s]: time since the reset in which there were any."""

    def __init__(
        self,
        constants: Constants,
        layers: Layers,
        particles: Particles,
        boundary: Boundary,
        neighbours: NeighbourList,
        impulses: ImpulseLedger,
    ):
        self.constants, self.layers, self.particles = constants, layers, particles
        self.boundary, self.neighbours, self.impulses = boundary, neighbours, impulses
        self.table, self.apertures = constants.openings, Apertures(constants)
        self.all: list[Opening] = []
        self.inlets: dict[int, Inlet] = {}
        self.within: set[int] = set()  # openings that lie on no wall
        self.waiting: set[int] = set()
        self.waited = 0.0
        self.pumps: dict[int, tuple[Opening, LayerSpec]] = {}
        self.owed = np.zeros(MAX_OPENINGS)  # particles that pumps have yet to take
        # Prescribed speeds [m/s] at the end of the step, and means over the step.
        self.speeds, self.means = np.zeros(MAX_OPENINGS), np.zeros(MAX_OPENINGS)

    def message(self) -> str | None:
        """Returns a message if inflows have waited since the reset, else None."""
        if self.waited == 0.0:
            return None
        held = f"the pool of {self.particles.capacity:,} particles is full"
        return f"{held}: inflows have waited for {self.waited:.2g} s"

    @property
    def top_speed(self) -> float:
        """Largest prescribed speed [m/s]."""
        return float(self.speeds.max())

    def load(self, openings: Sequence[Opening], walls: np.ndarray) -> None:
        """Replaces the openings; those that stay keep their progress. walls (3,) [m]: the far
        walls."""
        present = {id(inlet.opening): inlet for inlet in self.inlets.values()}
        specs, changed = self.layers.specs, bool(self.all or openings)
        self.all, self.inlets = list(openings), {}
        for k, opening in enumerate(self.all):
            if opening.enters:
                found = present.get(id(opening))
                self.inlets[k] = found or Inlet(opening, specs[opening.layer])
        self.pumps = {
            k: (o, specs[o.layer])
            for k, o in enumerate(self.all)
            if not o.enters and o.speed is not None
        }
        rows = [o.row(specs[o.layer], walls) for o in self.all]
        if changed:
            self.table.fill(**{name: [row[name] for row in rows] for name in (rows or [{}])[0]})
        self.constants.opening_count[None] = len(rows)
        self.neighbours.opened = any(row["wall"] for row in rows)
        self.within = {k for k, row in enumerate(rows) if not row["wall"]}
        self.speeds[:], self.means[:] = 0.0, 0.0
        self.waiting.clear()
        if not openings:
            self.waited, self.owed[:] = 0.0, 0.0
        if changed:
            self._mark(self.particles.count)
            self._prescribe(0)
            self.particles.extend(np.zeros((0, 3)), np.zeros((0, 3)), 0, 0)

    def begin(self, time: float) -> None:
        """Sets the prescribed speeds at the end of a step, at `time` [s]."""
        for k, opening in enumerate(self.all):
            speed = 0.0
            if opening.speed is not None and k not in self.waiting:
                speed = max(0.0, opening.speed(time))
            if speed != self.speeds[k]:
                self.table.speed[k] = speed
            if speed + self.speeds[k] != 2.0 * self.means[k]:
                self.table.mean_speed[k] = self.means[k] = 0.5 * (speed + self.speeds[k])
            self.speeds[k] = speed

    def mark(self) -> None:
        """Finds the particles whose velocities are prescribed."""
        if self.all:
            self._mark(self.particles.count)

    def prescribe(self) -> None:
        """Sets the velocities in the zones at the end of a step."""
        if self.all:
            self._prescribe(self.particles.count)

    def fill_pipes(self, openings: Sequence[Opening], gravity: tuple[float, float, float]) -> None:
        """Fills the zones of these openings beyond walls, so that no water flows into them.
        gravity: as in pour()."""
        for k, inlet in self.inlets.items():
            if inlet.opening in openings and k not in self.within:
                # The first sheet is half a distance before the wall.
                inlet.way = ZONE * inlet.spec.spacing + 0.5 * inlet.distance
        self.pour(0.0, gravity)

    def pour(self, dt: float, gravity: tuple[float, float, float]) -> int:
        """Adds the sheets that are due after a step of dt [s] under gravity [m/s^2], for their
        potential energy; returns the number of particles."""
        count = self.particles.count
        self.waiting.clear()
        for k, inlet in self.inlets.items():
            inlet.way += dt * self.means[k]
            while inlet.way >= inlet.distance and k not in self.waiting:
                if not self._add_sheet(k, inlet, np.array(gravity)):
                    self.waiting.add(k)
        self.waited += dt * bool(self.waiting)
        return self.particles.count - count

    def take(self, dt: float) -> np.ndarray:
        """Returns the indices (k,) of the particles that pumps take in a step of dt [s]."""
        taken: list[int] = []
        for k, (pump, spec) in self.pumps.items():
            self.owed[k] += dt * self.means[k] * pump.area / spec.volume
            if self.owed[k] < 1.0:
                continue
            near = self._nearest(pump, spec, taken)[: int(self.owed[k])]
            taken += near
            # What water was too far to be taken is not taken later.
            self.owed[k] = self.owed[k] % 1.0
        return np.array(taken, np.int32)

    def _nearest(self, pump: Opening, spec: LayerSpec, taken: list[int]) -> list[int]:
        """Returns the particles within reach of a pump but `taken` ones, the nearest first."""
        r = self.particles.numpy("x") - pump.centre
        distance, sides = np.abs(r @ pump.along), r @ pump.frame.T
        half = np.array(pump.half) + SLACK * spec.spacing
        inside = (np.abs(sides) <= half).all(axis=1)
        if pump.edges is None:
            inside = (sides**2).sum(axis=1) <= half[0] ** 2
        found = np.flatnonzero(inside & (distance < REACH * spec.spacing))
        found = found[np.argsort(distance[found])]
        return [i for i in found.tolist() if i not in taken]

    def _add_sheet(self, k: int, inlet: Inlet, gravity: np.ndarray) -> bool:
        """Adds a sheet; returns False if the pool has no room."""
        opening, spec = inlet.opening, inlet.spec
        advance = inlet.way - inlet.distance - ZONE * spec.spacing
        x = (opening.centre + advance * opening.along + inlet.sites).astype(np.float32)
        if k in self.within:
            free = np.zeros(len(x), np.int32)
            self._find_free(self.particles.count, x, LEAST_GAP * spec.spacing, free)
            x = x[(free == 1) & self.boundary.free(x)]
        if self.particles.count + len(x) > self.particles.capacity:
            return False
        inlet.way -= inlet.distance
        v = np.tile(self.speeds[k] * opening.along, (len(x), 1)).astype(np.float32)
        self.particles.extend(x, v, opening.layer, 1 + k)
        self.impulses.add_inflow(spec.mass, x, v, gravity)
        return True

    def state(self) -> np.ndarray:
        """Returns the ways [m] of the last sheets of inflows, and what pumps owe, for
        checkpoints."""
        return np.array([*(inlet.way for inlet in self.inlets.values()), *self.owed])

    def restore(self, state: np.ndarray, time: float) -> None:
        """Restores a state() of `time` [s]."""
        for inlet, way in zip(self.inlets.values(), state.tolist(), strict=False):
            inlet.way = way
        self.owed[:] = state[len(self.inlets) :]
        self.begin(time)

    @kernel
    def _mark(self, n: ti.i32):
        for i in range(n):
            self.particles.prescribed[i] = self.apertures.prescriber(self.particles.x[i])

    @kernel
    def _prescribe(self, n: ti.i32):
        """v = speed along the flow. The work [J] is that of a piston, which moves with the mean
        speed of the step: m dv.v_mean, of which the pressure solve takes up the part by pressure.
        """
        p = self.particles
        for i in range(n):
            k = p.prescribed[i] - 1
            if k >= 0:
                m, along = self.layers.mass[p.layer[i]], self.table.along[k]
                change = m * (self.table.speed[k] * along - p.v[i])
                self.impulses.inflow_impulse.add(i, change)
                self.impulses.inflow_work.add(i, self.table.mean_speed[k] * change.dot(along))
                p.v[i] = self.table.speed[k] * along

    @kernel
    def _find_free(
        self,
        n: ti.i32,
        x: ti.types.ndarray(dtype=ti.f32, ndim=2),
        gap: ti.f32,
        free: ti.types.ndarray(dtype=ti.i32, ndim=1),
    ):
        """Sets free to 1 for the points x [m] farther than `gap` [m] from all particles."""
        for k in range(x.shape[0]):
            nearest = 1e9
            for i in range(n):
                r = self.particles.x[i] - vec3(x[k, 0], x[k, 1], x[k, 2])
                nearest = ti.min(nearest, r.norm_sqr())
            free[k] = ti.cast(nearest > gap * gap, ti.i32)
