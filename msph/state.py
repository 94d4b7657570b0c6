"""State: one frame of water and bodies, all that surface, image and window read of a simulation.

Steps need not end with frames: particles of a simulation may be up to a step ahead of the frame.
Between forces they move with constant velocities, so that they are moved back along them.
"""

import contextlib
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import taichi as ti

from msph.fluid.constants import Constants
from msph.fluid.external_forces import STILL, Hand, Vec3
from msph.fluid.particles.grid import LayeredGrid
from msph.fluid.particles.particles import CORE, Attribute, Particles
from msph.fluid.plan import Plan
from msph.fluid.room import Room
from msph.fluid.simulation import Simulation
from msph.fluid.world import Builder, World
from msph.launches import data_oriented, kernel

vec3 = ti.math.vec3

# The attribute that is viewed, in its own unit; the length of a vector.
VIEWED = Attribute("viewed", "-", "attribute that colours the particles")


@dataclass(frozen=True)
class Moment:
    """Numbers of a State.

    time [s], at the end of the frame; simulated [s]: simulated time of the frame; tilt (3, 3) and
    shift (3,) [m] of the box, see Pose; gravity [m/s^2] in the box frame, hand and top_speed [m/s]
    of the water in this frame; ball: centre [m] and radius [m] of a hand that images show; spilt
    [kg]; energy [J]; solver_residual (-); fluid [s]: elapsed time of the fluid in this frame;
    resets: number of resets; stopped: names of stopped bodies; waiting: message about inflows that
    wait; picked: density [kg/m^3] and pressure [Pa] of the picked particle.
    """

    time: float = 0.0
    simulated: float = 0.0
    tilt: np.ndarray = field(default_factory=lambda: np.eye(3))
    shift: np.ndarray = field(default_factory=lambda: np.zeros(3))
    gravity: Vec3 = STILL
    hand: Hand = field(default_factory=Hand)
    top_speed: float = 0.0
    ball: tuple[Vec3, float] | None = None
    spilt: float = 0.0
    energy: float = np.nan
    solver_residual: float = np.nan
    fluid: float = 0.0
    resets: int = 0
    stopped: frozenset[str] = frozenset()
    waiting: str = ""
    picked: tuple[float, float] | None = None


@dataclass(frozen=True)
class Wanted:
    """What a window needs besides positions and velocities. view: name of the viewed attribute's
    view, "" for none; picked: id of the particle whose values are shown, None for none; numbers:
    names of measured numbers (Order.numbers)."""

    view: str = ""
    picked: int | None = None
    numbers: tuple[str, ...] = ()


NOTHING = Wanted()


@data_oriented
class State(Builder):
    """Particles at the end of a frame, `particles`, sorted into their own `grid`, and the tables,
    bodies and spilt drops (`rim`) that are drawn with them.

    now: the numbers of the frame; wanted: what was asked of the simulation for this frame. In the
    process of the simulation, tables, bodies and drops are the simulation's own. Objects with
    kernels above the fluid are built once for a state, by build_once().
    """

    def __init__(
        self,
        room: Room,
        constants: Constants,
        layers: Any,
        boundary: Any,
        rim: Any,
        openings: Any = None,
    ):
        self.room, self.constants, self.layers = room, constants, layers
        self.boundary, self.rim, self.openings = boundary, rim, openings
        self.particles = Particles(room.particles, (VIEWED,))
        self.grid = LayeredGrid(room, constants, layers, self.particles)
        self.now, self.wanted, self._ahead = Moment(), Wanted(), 0.0
        self._built: dict[Any, Any] = {}

    def load(self, plan: Plan) -> None:
        """Takes what depends on the scene, beside tables and bodies."""
        self.plan, self.region = plan, plan.region
        self.particles.capacity = plan.max_particles
        own = plan.method.attributes(plan.parameters, plan.adaptation is not None)
        # Attributes that have a view, by the view's name.
        self.attributes = {a.view: a for a in (*CORE, *own) if a.view}

    def counts(self) -> list[int]:
        """Returns the number of particles of each layer."""
        return np.bincount(self.particles.numpy("layer"), minlength=self.layers.count).tolist()

    def take(self, sim: Simulation, now: Moment, wanted: Wanted = NOTHING) -> None:
        """Copies the particles of a simulation, and moves them to where they are at the end of the
        frame. Changes nothing in the simulation."""
        if wanted.view == "density_error" or wanted.picked is not None:
            # Sorts the particles of the simulation.
            sim.measure_density()
            now = replace(now, picked=self._values_of(sim, wanted.picked))
        n = self.particles.count = sim.particles.count
        self._copy(sim.particles, n, -sim.ahead, sim.region)
        if wanted.view in self.attributes:
            attribute = self.attributes[wanted.view]
            self._view(sim.particles.fields[attribute.name], attribute.width == 3, n)
        self.grid.invalidate()
        self.now, self.wanted, self._ahead = now, wanted, sim.ahead

    @staticmethod
    def _values_of(sim: Simulation, picked: int | None) -> tuple[float, float] | None:
        """Returns density [kg/m^3] and pressure [Pa] of the particle with the id `picked`, if
        any."""
        found = np.flatnonzero(sim.particles.numpy("id") == picked)
        if len(found) == 0:
            return None
        density, pressure = (sim.particles.numpy(name) for name in ("density", "pressure"))
        return float(density[found[0]]), float(pressure[found[0]])

    def at_frame(self) -> contextlib.AbstractContextManager[None]:
        """Returns a context in which the bodies are where they are at the end of the frame."""
        return self.boundary.shifted(-self._ahead)

    @kernel
    def _copy(self, source: ti.template(), n: ti.i32, dt: ti.f32, size: vec3):
        """Copies the particles and moves them by dt [s], at most up to the walls of the region."""
        ti.loop_config(serialize=self.traits.light)
        for i in range(n):
            x, v = source.x[i], source.v[i]
            moved = ti.math.clamp(x + dt * v, ti.min(x, 0.0), ti.max(x, size))
            self.particles.x[i], self.particles.v[i] = moved, v
            self.particles.layer[i], self.particles.id[i] = source.layer[i], source.id[i]

    @kernel
    def _view(self, source: ti.template(), vector: ti.template(), n: ti.i32):
        """Copies an attribute, of a vector its length."""
        ti.loop_config(serialize=self.traits.light)
        for i in range(n):
            if ti.static(vector):
                self.particles.viewed[i] = source[i].norm()
            else:
                self.particles.viewed[i] = source[i]


def state_of(world: World) -> State:
    """Builds a state beside a simulation, which shares its tables and bodies (for
    World.build_once)."""
    parts = world.parts
    own = parts.constants, parts.layers, parts.boundary, parts.rim, parts.openings
    return State(parts.room, *own)
