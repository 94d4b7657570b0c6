"""Checkpoints: the whole state of a simulation as arrays."""

import math
from typing import TYPE_CHECKING

import numpy as np

from msph.fluid.boundary.added import body_of, body_row, opening_of, opening_row
from msph.fluid.boundary.floating import FloatingBodies
from msph.fluid.boundary.opening import ZONE
from msph.fluid.boundary.pistons import Stroke
from msph.fluid.room import MAX_BODIES

if TYPE_CHECKING:
    from msph.fluid.simulation import Simulation

# Entries of a checkpoint that are neither attributes nor numbers of the solver.
NAMES = {
    *("time", "ahead", "steps", "last_step", "fluid", "floating"),
    *("openings", "added_bodies", "added_openings", "piston"),
}
# Largest time [s] by which particles are ahead of a checkpoint: the longest frame.
MAX_AHEAD = 1.0


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
    floats = sum(b.mass is not None for b in sim.plan.bodies)
    # Entries that exist only if something was added, in this simulation or before the checkpoint.
    optional = {"added_bodies", "added_openings", "piston"}
    optional |= {"floating"} if not floats else set()
    optional |= {"openings"} if not sim.plan.openings else set()
    missing = set(state_of(sim)) - optional - set(state)
    if missing:
        raise ValueError(f"{', '.join(sorted(missing))} missing")
    fluid, own = state["fluid"], fingerprint(sim)
    if fluid.shape != own.shape or not np.allclose(fluid, own):
        raise ValueError("box or layers differ from the scene")
    _check(sim, state, floats)
    put_back(sim, state)


def _check(sim: "Simulation", state: dict[str, np.ndarray], floats: int) -> None:
    """Raises ValueError unless the numbers of a checkpoint are possible; `floats`: number of the
    scene's floating bodies."""
    attributes = _attributes(sim, state)
    sim.particles.check(attributes)
    x, layer = attributes["x"], attributes["layer"]
    opened = bool(sim.plan.openings or len(state.get("added_openings", ())))
    reach = ZONE * max(s.spacing for s in sim.layers.specs) * opened
    if np.any(x < -reach) or np.any(x > sim.walls + reach):
        raise ValueError("particles outside the box")
    if layer.min() < 0 or layer.max() >= sim.layers.count:
        raise ValueError(f"layer index not in 0 to {sim.layers.count - 1}")
    time, last_step, ahead = (float(state[k]) for k in ("time", "last_step", "ahead"))
    if not 0.0 <= time < math.inf:
        raise ValueError(f"time is {time:g} s: must be finite and at least 0")
    if not 0.0 <= ahead <= MAX_AHEAD:
        raise ValueError(f"particles are {ahead:g} s ahead: must be 0 to {MAX_AHEAD:g} s")
    if not last_step > 0.0:
        raise ValueError(f"last step is {last_step:g} s: must be positive")
    added = len(state.get("added_bodies", ()))
    if len(sim.plan.bodies) + added + ("piston" in state) > MAX_BODIES:
        raise ValueError(f"more than {MAX_BODIES} bodies")
    floating = state.get("floating", FloatingBodies().state())
    if floating.shape != (floats + added, FloatingBodies().state().shape[1]):
        raise ValueError("number of floating bodies differs from the scene")
    if not np.isfinite(floating).all():
        raise ValueError("floating bodies are not at finite positions and speeds")
    spilt = float(state["spilt"]) if sim.plan.open_top else 0.0
    if not 0.0 <= spilt < math.inf:
        raise ValueError(f"{spilt:g} kg were spilt: must be finite and at least 0")


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
