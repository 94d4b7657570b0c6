"""Checkpoints: the whole state of a simulation as arrays."""

import math
from typing import TYPE_CHECKING

import numpy as np

from msph.fluid.boundary.added import body_of, body_row, opening_of, opening_row
from msph.fluid.boundary.floating import FloatingBodies
from msph.fluid.boundary.opening import ZONE
from msph.fluid.boundary.pistons import Stroke
from msph.fluid.boundary.rigid_bodies import Body, bounding_radius, inertia
from msph.fluid.constants import MAX_OPENINGS
from msph.fluid.room import MAX_BODIES
from msph.parameter import LARGEST, LONGEST, MAX_SPEED

if TYPE_CHECKING:
    from msph.fluid.simulation import Simulation

# Entries of a checkpoint that are neither attributes nor numbers of the solver.
NAMES = {
    *("time", "ahead", "steps", "last_step", "fluid", "floating"),
    *("openings", "added_bodies", "added_openings", "piston"),
}
# Largest time [s] by which particles are ahead of a checkpoint: the longest frame.
MAX_AHEAD = 1.0
# Largest number of a counter (int32), and of quantities without a limit of their own.
MAX_COUNT = 2**31 - 1
# Shortest step [s], far below those of water at MAX_SPEED.
SHORTEST_STEP = 1e-9
# Largest rate that bounds a step, over that of water at MAX_SPEED past its neighbours (-).
TOP_RATE = 10.0
# Largest way of an inflow beyond its last sheet [spacings]: waiting inflows stand still.
MAX_WAY = 100.0


def state_of(sim: "Simulation") -> dict[str, np.ndarray]:
    """Returns a checkpoint of a Simulation: every carried attribute, time, time by which the
    particles are ahead, number of steps, length of the last step, the spilt mass [kg] of an open
    box, the state of floating bodies and openings, added bodies and openings, the piston, the
    solver's state and the fingerprint."""
    progress = {
        "time": np.float64(sim.time),
        "ahead": np.float64(sim.ahead),
        "steps": np.int64(sim.steps),
        "last_step": np.float64(sim.last_step),
    }
    solver = {f"solver.{k}": np.float64(v) for k, v in sim.solver.state().items()}
    if sim.plan.open_top:
        progress["spilt"] = np.float64(sim.rim.mass)
    if sim.boundary.floating.count:
        progress["floating"] = sim.boundary.floating.state()
    if sim.openings.all:
        progress["openings"] = sim.openings.state()
    bodies = [b for b in sim.boundary.bodies[len(sim.plan.bodies) :] if b.mass is not None]
    if bodies:
        progress["added_bodies"] = np.stack([body_row(b) for b in bodies])
    if sim.added_openings:
        progress["added_openings"] = np.stack([opening_row(o) for o in sim.added_openings])
    if sim.piston:
        progress["piston"] = sim.piston.state()
    return {**progress, **solver, "fluid": fingerprint(sim), **sim.particles.state()}


def fingerprint(sim: "Simulation") -> np.ndarray:
    """Returns the box [m] and layer masses [kg], which checkpoint and scene must share."""
    return np.array([*sim.size, *(s.mass for s in sim.layers.specs)])


def restore(sim: "Simulation", state: dict[str, np.ndarray]) -> None:
    """Restores a checkpoint of state_of(). Raises ValueError if it does not fit this simulation."""
    floats = [b for b in sim.plan.bodies if b.mass is not None]
    # Entries that exist only if something was added, in this simulation or before the checkpoint.
    optional = {"added_bodies", "added_openings", "piston"}
    optional |= {"floating"} if not floats else set()
    optional |= {"openings"} if not sim.plan.openings else set()
    missing = set(state_of(sim)) - optional - set(state)
    if missing:
        raise ValueError(f"{', '.join(sorted(missing))} missing")
    own = fingerprint(sim)
    if not np.allclose(numbers(state, "fluid", own.shape), own):
        raise ValueError("box or layers differ from the scene")
    _check(sim, state, floats)
    put_back(sim, state)


def numbers(
    state: dict[str, np.ndarray],
    name: str,
    shape: tuple[int, ...],
    lo: float = -LARGEST,
    hi: float = LARGEST,
) -> np.ndarray:
    """Returns an entry of a checkpoint in double precision. Raises ValueError unless it has this
    shape and real numbers from `lo` to `hi`."""
    found = np.asarray(state[name])
    if found.dtype.kind not in "fiu" or found.shape != shape:
        raise ValueError(f"{name} is {found.dtype} of shape {found.shape}, not numbers of {shape}")
    # Not a number is refused, too.
    values = found.astype(float)
    wrong = values[~((values >= lo) & (values <= hi))]
    if wrong.size:
        raise ValueError(f"{name} is {wrong.flat[0]:g}: must be {lo:g} to {hi:g}")
    return values


def _check(sim: "Simulation", state: dict[str, np.ndarray], floats: list[Body]) -> None:
    """Raises ValueError unless the numbers of a checkpoint are possible; `floats`: the scene's
    floating bodies."""
    attributes, specs = _attributes(sim, state), sim.layers.specs
    sim.particles.check(attributes)
    finest = min(s.spacing for s in specs)
    limits = {"m/s": MAX_SPEED, "Pa": specs[0].density * MAX_SPEED**2}
    for name, found in attributes.items():
        most = limits.get(sim.particles.attributes[name].unit, MAX_COUNT)
        numbers(state, name, found.shape, -most, most)
    numbers(state, "layer", attributes["layer"].shape, 0, sim.layers.count - 1)
    scalars = {"time": (0.0, LONGEST), "ahead": (0.0, MAX_AHEAD), "steps": (0, 2**53)}
    scalars |= {"last_step": (SHORTEST_STEP, math.inf), "spilt": (0.0, LARGEST)}
    scalars |= {f"solver.{k}": (0.0, MAX_COUNT) for k in sim.solver.state()}
    scalars["solver.top_rate"] = 0.0, TOP_RATE * MAX_SPEED / finest
    for name, (lo, hi) in scalars.items():
        if name in state:
            numbers(state, name, (), lo, hi)
    bodies = [*floats, *(body_of(row) for row in state.get("added_bodies", ()))]
    if len(sim.plan.bodies) + len(bodies) - len(floats) + ("piston" in state) > MAX_BODIES:
        raise ValueError(f"more than {MAX_BODIES} bodies")
    if bodies:
        _check_floating(state, bodies)
    added = [opening_of(row, sim.layers.count) for row in state.get("added_openings", ())]
    for opening in added:
        problem = opening.problem(sim.walls, specs[opening.layer].spacing)
        if problem:
            raise ValueError(f"an added opening {problem}")
    inlets = [specs[o.layer].spacing for o in (*sim.plan.openings, *added) if o.enters]
    if sim.plan.openings or added:
        flows = numbers(state, "openings", (len(inlets) + MAX_OPENINGS,), 0.0, MAX_COUNT)
        if (flows[: len(inlets)] > MAX_WAY * np.array(inlets)).any():
            raise ValueError(f"an inflow is more than {MAX_WAY:g} spacings late")
    reach = ZONE * max(s.spacing for s in specs) * bool(sim.plan.openings or added)
    x = attributes["x"]
    if np.any(x < -reach) or np.any(x > sim.walls + reach):
        raise ValueError("particles outside the box")


def _check_floating(state: dict[str, np.ndarray], bodies: list[Body]) -> None:
    """Raises ValueError unless the rows of floating bodies are possible."""
    if "floating" not in state or len(state["floating"]) != len(bodies):
        raise ValueError("number of floating bodies differs from the scene")
    rows = numbers(state, "floating", (len(bodies), FloatingBodies().state().shape[1]))
    for row, body in zip(rows, bodies, strict=True):
        turn = row[3:12].reshape(3, 3)
        if not np.allclose(turn @ turn.T, np.eye(3), atol=1e-3) or np.linalg.det(turn) < 0.0:
            raise ValueError("a floating body is not at a rotation")
        # A bound of the angular momentum at which the surface moves at MAX_SPEED.
        spin = np.linalg.norm(inertia(body), 2) * MAX_SPEED / bounding_radius(body)
        if np.linalg.norm(row[12:15]) > MAX_SPEED or np.linalg.norm(row[15:18]) > spin:
            raise ValueError(f"a floating body is faster than {MAX_SPEED:g} m/s")


def put_back(sim: "Simulation", state: dict[str, np.ndarray]) -> None:
    """Restores a state_of() of this simulation, whatever its numbers are. Raises ValueError for
    rows of added bodies, openings or a piston that describe none."""
    added = [body_of(row) for row in state.get("added_bodies", ())]
    openings = [opening_of(row, sim.layers.count) for row in state.get("added_openings", ())]
    stroke = Stroke.of(state["piston"]) if "piston" in state else None
    time, ahead = float(state["time"]), float(state["ahead"])
    spilt = float(state["spilt"]) if sim.plan.open_top else 0.0
    sim.start_from(_attributes(sim, state), time, int(state["steps"]), spilt, ahead)
    for opening in openings:
        sim.take_opening(opening)
    if sim.plan.openings or openings:
        sim.openings.restore(state.get("openings", np.zeros(0)), sim.reached)
    for body in added:
        sim.take_body(body)
    if stroke:
        sim.add_piston(stroke)
    sim.boundary.restore(sim.reached, state.get("floating", FloatingBodies().state()))
    sim.last_step = float(state["last_step"])
    sim.solver.restore({k: float(state[f"solver.{k}"]) for k in sim.solver.state()})


def _attributes(sim: "Simulation", state: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Returns the attributes of the particles in a checkpoint, and entries of unknown names."""
    own = {f"solver.{k}" for k in sim.solver.state()} | ({"spilt"} if sim.plan.open_top else set())
    return {k: v for k, v in state.items() if k not in NAMES | own}
