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

Inflows wait while the pool of particles has no room for their next sheet, or a closed box none for
its volume: their water would otherwise be compressed without limit.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import taichi as ti

from msph.fluid.boundary.opening import SLACK, ZONE, Opening
from msph.fluid.boundary.rigid_bodies import volume
from msph.fluid.boundary.walls import NO_WALL
from msph.fluid.constants import MAX_OPENINGS
from msph.fluid.part import Part, Parts
from msph.fluid.particles.layers import LayerSpec
from msph.fluid.particles.particles import Attribute
from msph.launches import data_oriented, kernel

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

# Largest distance from a pump of the particles that it takes [spacings].
REACH = 1.5
# Distance of a new particle from others, in spacings, below which it is left out.
LEAST_GAP = 0.7


class Inlet:
    """Progress of an inflow: sites (n, 3) [m] of a sheet relative to the centre of the opening,
    distance [m] of sheets, and way [m] of the last sheet from the far end of the zone."""

    def __init__(self, opening: Opening, spec: LayerSpec):
        self.opening, self.spec = opening, spec
        self.sites, self.distance = opening.sites(spec)
        self.way = self.distance  # the first sheet is due at once


@data_oriented
class Openings(Part):
    """The openings of a simulation, `all`. waiting: inflows for whose next sheet there is no room;
    waited [s]: time since the reset in which any inflow waited; lack: what was full when one waited
    last; space [m^3]: of a closed box and the pipes behind its walls, infinite if water can leave;
    far (3,) [m]: the far walls."""

    def __init__(self, parts: Parts):
        super().__init__(parts)
        self.rows: list[dict[str, Any]] = []  # of the table
        self.table = self.constants.openings
        self.all: list[Opening] = []
        self.inlets: dict[int, Inlet] = {}
        self.within: set[int] = set()  # openings that lie on no wall
        self.waiting: set[int] = set()
        self.waited, self.lack = 0.0, ""
        self.space, self.far = np.inf, np.zeros(3)
        self.pumps: dict[int, tuple[Opening, LayerSpec]] = {}
        self.owed = np.zeros(MAX_OPENINGS)  # particles that pumps have yet to take
        # Prescribed speeds [m/s] at the end of the step, and means over the step.
        self.speeds, self.means = np.zeros(MAX_OPENINGS), np.zeros(MAX_OPENINGS)

    def message(self) -> str | None:
        """Returns a message if inflows have waited since the reset, else None."""
        if self.waited == 0.0:
            return None
        return f"{self.lack} is full: inflows have waited for {self.waited:.2g} s"

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
        rows = self.rows = [o.row(specs[o.layer], walls) for o in self.all]
        if changed:
            self.table.fill(**{name: [row[name] for row in rows] for name in (rows or [{}])[0]})
        self.constants.opening_count[None] = len(rows)
        self.images.opened = any(row["wall"] for row in rows)
        self.within = {k for k, row in enumerate(rows) if not row["wall"]}
        pipes = [
            ZONE * i.spec.spacing * i.opening.area
            for k, i in self.inlets.items()
            if k not in self.within
        ]
        # Water leaves through outflows and over the rim, whose far wall is at NO_WALL.
        leaves = len(self.inlets) < len(self.all) or (walls >= NO_WALL).any()
        closed = not leaves and self.boundary.container is None
        self.space, self.far = float(np.prod(walls)) + sum(pipes) if closed else np.inf, walls
        self.speeds[:], self.means[:] = 0.0, 0.0
        self.waiting.clear()
        if not openings:
            self.waited, self.owed[:] = 0.0, 0.0
        if changed:
            self._mark(self.particles.count)
            self._prescribe(0)
            # Launched without particles: compiles the kernel before the first sheet.
            self._find_free(0, np.zeros((1, 3), np.float32), 0.0, np.zeros(1, np.int32))

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
        """Adds the sheets that are due after a step of dt [s]; returns the number of particles.
        gravity [m/s^2]: for their potential energy."""
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
            # Water that was too far away to be taken is not taken later.
            self.owed[k] = self.owed[k] % 1.0
        return np.array(taken, np.int32)

    def _nearest(self, pump: Opening, spec: LayerSpec, taken: list[int]) -> list[int]:
        """Returns the particles within reach of a pump that are not `taken`, the nearest first."""
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
        """Adds a sheet; returns False without room for it."""
        opening, spec = inlet.opening, inlet.spec
        advance = inlet.way - inlet.distance - ZONE * spec.spacing
        x = (opening.centre + advance * opening.along + inlet.sites).astype(np.float32)
        if k in self.within:
            free = np.zeros(len(x), np.int32)
            self._find_free(self.particles.count, x, LEAST_GAP * spec.spacing, free)
            x = x[(free == 1) & self.boundary.free(x)]
        if self.particles.count + len(x) > self.particles.capacity:
            self.lack = f"the pool of {self.particles.capacity:,} particles"
            return False
        needed = len(inlet.sites) * spec.volume
        if self.space < np.inf and self._water() + needed > self.space - self._solids():
            self.lack = "the box"
            return False
        inlet.way -= inlet.distance
        v = np.tile(self.speeds[k] * opening.along, (len(x), 1)).astype(np.float32)
        self.particles.extend(x, v, opening.layer, 1 + k)
        self.impulses.add_inflow(spec.mass, x, v, gravity)
        return True

    def _water(self) -> float:
        """Returns the volume [m^3] of all particles."""
        volumes = np.array([s.volume for s in self.layers.specs])
        return float(volumes[self.particles.numpy("layer")].sum())

    def _solids(self) -> float:
        """Returns the volume [m^3] of the bodies that are in the box as a whole."""
        if not self.boundary.bodies:
            return 0.0
        x = self.boundary.corners_at_end()
        inside = ((x >= 0.0) & (x <= self.far)).all(axis=(1, 2))
        return sum(volume(b) for b, i in zip(self.boundary.bodies, inside, strict=True) if i)

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
        ti.loop_config(serialize=self.traits.light)
        for i in range(n):
            self.particles.prescribed[i] = self.apertures.prescriber(self.particles.x[i])

    @kernel
    def _prescribe(self, n: ti.i32):
        """v = speed along the flow. The work [J] is the work of a piston that moves with the mean
        speed of the step, m dv.v_mean; dv also undoes the change of v by the pressure solve.
        """
        p = self.particles
        ti.loop_config(serialize=self.traits.light)
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
