"""Bodies that are stopped since they would trap water."""

from collections.abc import Callable

from msph.fluid.simulation import Simulation
from msph.fluid.trapped_water import TrappedWaterError


class Stops:
    """Stops of a simulation's bodies. stopped: names of bodies that have been stopped since the
    start; note: message about the last frame, "" without one."""

    def __init__(self, simulation: Simulation):
        self.simulation = simulation
        self.stopped, self.note = set[str](), ""

    def advance(self, frame_time: float, frame: Callable[[], float]) -> float:
        """Calls `frame`, which advances the simulation by a frame of `frame_time` [s] and returns
        the simulated time [s]. A frame in which a body traps water is undone, and the body stops a
        frame earlier; a piston is removed."""
        sim, self.note = self.simulation, ""
        before = sim.mark() if sim.boundary.driven else None
        try:
            return frame()
        except TrappedWaterError as error:
            if before is None:
                raise
            times = dict(sim.boundary.stopped)
            by_wall = sim.boundary.bodies[error.body].motion is sim.piston
            sim.undo(before)
            if by_wall:
                sim.remove_piston()
                self.note = f"{error.name} is gone: it had trapped water"
                return 0.0
            # Repeated stops of a body move it back farther: the compressed water needs room.
            now = sim.reached
            times[error.body] = min(now, times.get(error.body, now)) - frame_time
            for body, since in times.items():
                sim.boundary.stop(body, since)
            sim.boundary.place(now, 0.0)
            self.stopped.add(error.name)
            return 0.0
