"""Transfer of a State to another process: its arrays in shared memory, all else in a Packet.

The process of the window has its own tables, bodies and drops, filled from the same Plan, and reads
the particles of each frame into its own fields, so that surface and image do not know where the
simulation runs.
"""

import contextlib
from dataclasses import dataclass
from multiprocessing.shared_memory import SharedMemory
from typing import Any

import numpy as np

from msph.fluid.boundary.boundary import Boundary
from msph.fluid.boundary.rigid_bodies import Body, Solid
from msph.fluid.boundary.rim import MOST_DROPS, drop_table
from msph.fluid.constants import Constants
from msph.fluid.particles.layers import Layers
from msph.fluid.plan import Plan
from msph.fluid.room import Room, room_for
from msph.fluid.world import GROWTH
from msph.launches import Traits, use_traits
from msph.state import Moment, State, Wanted

# Arrays of the particles.
PARTICLES = ("x", "v", "viewed", "layer", "id")
# Each set of arrays is read while the next one is written.
SETS = 2


def arrays_type(capacity: int) -> np.dtype:
    """Returns the type of a set of arrays for up to `capacity` particles; the columns of `drops`
    are those of Rim.read_drops."""
    vectors, numbers = (capacity, 3), (capacity,)
    return np.dtype(
        [
            ("x", "f4", vectors),
            ("v", "f4", vectors),
            ("viewed", "f4", numbers),
            ("layer", "i4", numbers),
            ("id", "i4", numbers),
            ("drops", "f4", (MOST_DROPS, 8)),
        ]
    )


@dataclass(frozen=True)
class Packet:
    """All of a state but its arrays. count: of particles; spilt: True if there are drops; centres
    [m] (bodies, 3) and turns (bodies, 3, 3) of the bodies; bodies, openings: the bodies, and the
    rows of the table of openings, if they have changed."""

    now: Moment
    wanted: Wanted
    count: int
    spilt: bool
    centres: np.ndarray
    turns: np.ndarray
    bodies: list[Body] | None
    openings: list[dict[str, Any]] | None


class SharedArrays:
    """Sets of arrays for up to `capacity` particles in shared memory; name: of existing memory,
    which the first process to attach removes from the system at once, so that nothing remains
    whatever happens to the processes."""

    def __init__(self, capacity: int, name: str | None = None):
        kind = arrays_type(capacity)
        self.memory = SharedMemory(name, create=name is None, size=SETS * kind.itemsize)
        self.name, self.owns = self.memory.name, name is None
        if not self.owns:
            self.memory.unlink()
        self.sets: Any = np.ndarray(SETS, kind, self.memory.buf)

    def close(self) -> None:
        self.sets = None
        self.memory.close()
        # Only if the other process has not attached.
        with contextlib.suppress(FileNotFoundError):
            if self.owns:
                self.memory.unlink()


class Sender:
    """Sends the states of one simulation."""

    def __init__(self, state: State):
        self.state = state
        # As sent last: identical lists are not sent again.
        self.bodies, self.openings = state.boundary.bodies, None

    def pack(self, arrays: np.void) -> Packet:
        """Writes the state's arrays and returns the rest."""
        state, drops = self.state, self.state.rim.has_drops
        for name in PARTICLES:
            arrays[name][: state.particles.count] = state.particles.numpy(name)
        if drops:
            state.rim.read_drops(arrays["drops"])
        with state.at_frame():
            centres, turns = state.boundary.poses_at_end()
        bodies = openings = None
        if self.bodies is not state.boundary.bodies:
            bodies = self.bodies = state.boundary.bodies
        if self.openings is not state.openings.rows:
            openings = self.openings = state.openings.rows
        more = drops, centres, turns, bodies, openings
        return Packet(state.now, state.wanted, state.particles.count, *more)


def receive(state: State, packet: Packet, arrays: np.void) -> None:
    """Takes a state of another process; state: of own_state()."""
    state.particles.fill(**{name: arrays[name][: packet.count] for name in PARTICLES})
    state.grid.invalidate()
    state.now, state.wanted = packet.now, packet.wanted
    state.rim.has_drops = packet.spilt
    if packet.spilt:
        columns = np.split(arrays["drops"], (3, 6, 7), axis=1)
        state.rim.drops.fill(**dict(zip(("x", "v", "radius", "life"), columns, strict=True)))
    if packet.bodies is not None:
        # Meshes that are here already have been sampled, which takes up to a second.
        own = {b.vertices.tobytes(): b for b in state.boundary.bodies if isinstance(b, Solid)}
        bodies = [
            own.get(b.vertices.tobytes(), b) if isinstance(b, Solid) else b for b in packet.bodies
        ]
        _load_bodies(state, bodies)
    if packet.openings is not None:
        _load_openings(state, packet.openings)
    if state.boundary.moving:
        state.boundary.take_poses(packet.centres, packet.turns)


class Drops:
    """Spilt drops of another process's simulation; see Rim."""

    def __init__(self) -> None:
        self.drops, self.has_drops = drop_table(), False


# States that are not in use, the last one first.
_stock: list[State] = []


def own_state(plan: Plan) -> State:
    """Returns a state with its own tables and bodies, filled with the initial particles, for
    exclusive use until give_back()."""
    found = next((s for s in _stock if s.room.holds(plan.needed)), None)
    if found:
        _stock.remove(found)
    else:
        with use_traits(Traits()):
            found = _build(room_for(plan.needed))
    growth = GROWTH if plan.adaptation else 1
    found.traits.particles = growth * len(plan.initial["x"])
    found.constants.fill(**plan.constants())
    found.layers.load(plan.specs, *plan.tables())
    found.load(plan)
    _load_bodies(found, list(plan.bodies))
    _load_openings(found, [])
    found.particles.fill(**{name: plan.initial[name] for name in ("x", "layer")})
    found.now, found.wanted, found.rim.has_drops = Moment(), Wanted(), False
    found.grid.invalidate()
    return found


def give_back(state: State) -> None:
    """Returns a state of own_state() to the stock."""
    _stock.insert(0, state)


def _build(room: Room) -> State:
    constants, layers = Constants(), Layers()
    return State(room, constants, layers, Boundary(room, constants, layers), Drops())


def _load_bodies(state: State, bodies: list[Body]) -> None:
    plan = state.plan
    state.boundary.load(plan.size, plan.specs, bodies, plan.open_top)
    state.traits.bodies = state.boundary.count > 0


def _load_openings(state: State, rows: list[dict[str, Any]]) -> None:
    names = rows[0] if rows else ()
    state.constants.openings.fill(**{name: [row[name] for row in rows] for name in names})
    state.constants.opening_count[None] = len(rows)
