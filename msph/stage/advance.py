"""Advance of a simulation by a frame, also where the water is trapped or all spilt."""

from typing import TYPE_CHECKING

from msph.fluid.boundary.rim import AllSpiltError
from msph.fluid.moving_box import MovingBox
from msph.fluid.trapped_water import TrappedWaterError
from msph.stage.controls import Controls

if TYPE_CHECKING:
    from msph.stage.show import Show


def advance(show: "Show", controls: Controls, external: MovingBox) -> float:
    """Advances the fluid by a frame and returns the simulated time [s]. With stop_bodies, a
    frame in which a body traps water is undone, and the body stops a frame earlier; and the
    scene begins again when all water is spilt."""
    sim, frame_time = show.simulation, controls.frame_time or show.frame_time
    before = sim.mark() if show.stop_bodies and sim.boundary.driven else None
    try:
        return sim.advance(
            frame_time,
            external,
            show.substage,
            controls.budget,
            show.clock,
            show.on_progress,
            controls.until,
            show.free_steps and not (external.turned_by_hand or sim.piston),
        )
    except AllSpiltError as error:
        if not show.stop_bodies:
            raise
        show.reset()
        show.note = f"{error}: the scene begins again"
        return 0.0
    except TrappedWaterError as error:
        if before is None:
            raise
        stopped = dict(sim.boundary.stopped)
        by_wall = sim.boundary.bodies[error.body].motion is sim.piston
        sim.undo(before)
        if by_wall:
            sim.remove_piston()
            show.note = f"{error.name} is gone: it had trapped water"
            return 0.0
        # Repeated stops of a body move it back farther: the compressed water needs room.
        now = sim.reached
        stopped[error.body] = min(now, stopped.get(error.body, now)) - frame_time
        _stop(show, stopped)
        show.stopped.add(error.name)
        return 0.0


def _stop(show: "Show", stopped: dict[int, float]) -> None:
    """Stops bodies, given as number: time of the stop [s]."""
    boundary, time = show.simulation.boundary, show.simulation.reached
    for body, since in stopped.items():
        boundary.stop(body, since)
    boundary.place(time, 0.0)
