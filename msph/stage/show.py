"""Show: simulation, display and ledger of one scene, advanced frame by frame."""

import contextlib
import math
import time
from collections.abc import Callable
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np

from msph.errors import MsphError
from msph.fluid.boundary.rim import AllSpiltError
from msph.fluid.moving_box import MovingBox
from msph.fluid.simulation import Mark
from msph.fluid.trapped_water import TrappedWaterError
from msph.measure.first_pressure import with_first_pressures
from msph.measure.ledger import Ledger
from msph.measure.past import read_state
from msph.measure.probes import Probe
from msph.measure.snapshot import Snapshot
from msph.measure.timings import Timings
from msph.own_files import replacing
from msph.scene.build import build_simulation
from msph.scene.errors import SceneError
from msph.scene.schema import Scene
from msph.stage.controls import Controls, Inputs
from msph.stage.display import Display
from msph.stage.pose import Pose
from msph.stage.shown_scene import ShownScene
from msph.stage.tools import Toolbox
from msph.state import Moment, State, state_of
from msph.surface import SurfaceMesh

# Key of a checkpoint for the description of a session in a window (autosave.About).
SESSION = "session"
# The first step after a start differs from later ones.
WARM_UP_FRAMES = 2

# Options of an interactive show: those on which the simulation depends, and all options. Solver
# residuals are measured only every 0.1 s, since they need a neighbour search.
SIMULATED: dict[str, Any] = {"stop_bodies": True, "free_steps": True, "spare": 2000}
INTERACTIVE: dict[str, Any] = {**SIMULATED, "interactive": True, "density_every": 0.1}


class Show(ShownScene):
    """Simulation with display and ledger, advanced frame by frame.

    frame_time [s]: default simulated time of a frame. size, meshes: see Display. density_every [s]:
    see Ledger. stop_bodies: instead of an error, a body that traps water stops, and the scene
    begins again when all water is spilt. interactive: frames
    may set the image scale, and compile kernels that the first image does not need. free_steps:
    steps need not end with frames, unless the user turns the box or moves a wall, whose motion is
    given by frame. simulated [s]: time simulated by the last frame; stopped: names of the bodies
    that were stopped. spare, room: see build_simulation. Unused parts are neither allocated nor
    compiled.
    """

    def __init__(
        self,
        scene: Scene,
        frame_time: float,
        size: tuple[int, int] | None = None,
        meshes: bool = False,
        timings: Timings | None = None,
        density_every: float = 0.0,
        stop_bodies: bool = False,
        interactive: bool = False,
        free_steps: bool = False,
        spare: int = 0,
        room: int = 0,
    ):
        super().__init__(scene, timings)
        self.frame_time = frame_time
        self.clock = time.perf_counter
        self.simulated = 0.0
        self.size, self.meshes = size, meshes
        self.stop_bodies, self.interactive = stop_bodies, interactive
        self.free_steps = free_steps
        self.simulation = build_simulation(scene, spare, room)
        self.counts, self.stopped = self.simulation.counts(), set[str]()
        self.ledger = Ledger(self.simulation, density_every)
        self.frames = self.resets = 0
        self.pose, self.tools = Pose(scene), Toolbox(self.simulation, scene.seed)
        self.now = Moment()
        self._observe(self._box())
        if size or meshes:
            self.display.reset()

    @property
    def draws(self) -> bool:
        """True if frames have an image or a mesh."""
        return bool(self.size or ("display" in vars(self) and self.display.meshes))

    @cached_property
    def state(self) -> State:  # type: ignore[override]
        """State that is drawn; see take()."""
        state = self.simulation.world.build_once(state_of)
        state.load(self.simulation.plan)
        return state

    @cached_property
    def display(self) -> Any:
        """Surface, image and camera."""
        return Display(self, self.size, self.meshes)

    def load(self, size: tuple[int, int] | None) -> None:
        """Prepares images of another size, None for no images, also after Simulation.unpark()."""
        self.size = size
        self.state.load(self.simulation.plan)
        if "display" in vars(self):
            self.take()
            self.display.load(size)

    def _changed(self, key: str) -> None:
        if key.startswith("picture.") and self.size:
            self.display.picture.change(self.scene.picture)
        if key.startswith(f"{self.scene.method}."):
            self.simulation.solver.tune(getattr(self.scene, self.scene.method))

    def warm_up(self, first_image: bool = False) -> None:
        """Compiles the kernels of a frame, by running two frames of a step each, and resets.
        Interactive shows also compile the kernels that the first images do not need, one function
        per frame with `first_image`."""
        for _ in range(WARM_UP_FRAMES):
            self.frame(Controls(budget=0.0))
        if self.interactive:
            self.later = self._later_kernels()
        while self.later and not first_image:
            self.later.pop(0)()
        self.reset()
        self.frames = 0
        self.timings.discard()

    def _later_kernels(self) -> list[Callable[[], Any]]:
        """Returns functions that compile kernels without effect on the next frame: for whitewater,
        tools, a smaller image, spilt water, other views, the autosave and added water."""
        sim = self.simulation
        nothing = np.zeros((0, 3))
        add = partial(sim.particles.extend, nothing, nothing, 0)
        drawn = self.display.later_kernels() if self.size else []
        return [*drawn, sim.rim.compile, sim.state, add]

    def close(self) -> None:
        """Drops all parts, so that another simulation can use their memory."""
        self.simulation.close()
        for part in ("simulation", "tools", "ledger", "display", "state"):
            setattr(self, part, None)

    def frame(self, controls: Controls) -> None:
        """Runs one frame: controls, fluid, ledger, surface, image."""
        for key, value in controls.set.items():
            self.set(key, value)
        if controls.reset:
            self.reset()
        if self.frames:
            self.compile_later()
        external, self.simulated = self._moving_box(controls), 0.0
        if not controls.still:
            with self.timings.stage("fluid"):
                self.simulated = self._advance(controls, external)
                if self.simulation.openings.waiting:
                    self.note = self.simulation.openings.message() or ""
            if self.simulated > 0.0:
                self.pose.place(self.simulation.time)
                self.ledger.record(external.gravity)
        self._observe(external)
        if self.draws:
            self.take()
            self.display.frame(controls)
        self.frames += 1
        self.timings.close_frame()

    def _advance(self, controls: Controls, external: MovingBox) -> float:
        """Advances the fluid by a frame and returns the simulated time [s]."""
        sim, frame_time = self.simulation, controls.frame_time or self.frame_time
        before = sim.mark() if self.stop_bodies and sim.boundary.driven else None
        try:
            return sim.advance(
                frame_time,
                external,
                self.timings.substage,
                controls.budget,
                self.clock,
                self.on_progress,
                controls.until,
                self.free_steps and not (external.turned_by_hand or sim.piston),
            )
        except AllSpiltError as error:
            if not self.stop_bodies:
                raise
            self.reset()
            self.note = f"{error}: the scene begins again"
        except TrappedWaterError as error:
            if before is None:
                raise
            self._stop(error, before, frame_time)
        return 0.0

    def _stop(self, error: TrappedWaterError, before: Mark, frame_time: float) -> None:
        """Undoes a frame of `frame_time` [s] in which a body trapped water, and stops the body a
        frame earlier; a piston is removed."""
        sim = self.simulation
        times = dict(sim.boundary.stopped)
        by_wall = sim.boundary.bodies[error.body].motion is sim.piston
        sim.undo(before)
        if by_wall:
            sim.remove_piston()
            self.note = f"{error.name} is gone: it had trapped water"
            return
        # Repeated stops of a body move it back farther: the compressed water needs room.
        now = sim.reached
        times[error.body] = min(now, times.get(error.body, now)) - frame_time
        for body, since in times.items():
            sim.boundary.stop(body, since)
        sim.boundary.place(now, 0.0)
        self.stopped.add(error.name)

    def _moving_box(self, controls: Controls) -> MovingBox:
        """Sets the tilt, uses the tool, and returns the external forces of the frame: gravity,
        hand, and the inertia of the scene's motion and of the user's tilt."""
        self.pose.take(controls, self.simulation.time)
        if controls.still:
            self.tools.ball = None
            self.pose.pause()
            return self._box()
        step = controls.frame_time or self.frame_time
        hand = self.tools.frame(controls.use, self.scene.play, self._box(), step)
        self.note = self.tools.note or self.note
        hand = hand if controls.use else controls.hand
        return self.pose.turn(self.scene.gravity, self.simulation.time, step, hand)

    def _box(self) -> MovingBox:
        """Returns the moving box now, without a hand and without a turn by the user."""
        return self.pose.at_rest(self.scene.gravity, self.simulation.time)

    def keep(self, checkpoint: Path) -> None:
        """Saves a checkpoint."""
        self.note = f"{checkpoint}; o opens it"
        try:
            with replacing(checkpoint) as new:
                np.savez_compressed(new, **self.simulation.state())  # type: ignore[arg-type]
        except (MsphError, OSError) as error:
            self.note = str(error)

    def reopen(self, checkpoints: list[Path], otherwise: str) -> None:
        """Continues from the first of these checkpoints that fits, or says `otherwise`."""
        for path in checkpoints:
            # A checkpoint of another quality has other layers.
            with contextlib.suppress(SceneError, OSError):
                self.resume(path)
                self.note = f"{path}, time {self.simulation.time:.2f} s"
                return
        self.note = otherwise

    def resume(self, checkpoint: Path) -> None:
        """Continues from a checkpoint, a .npz file of Simulation.state(). Raises SceneError."""
        try:
            state = read_state(checkpoint)
            state.pop(SESSION, None)
            self.simulation.restore(state)
        except ValueError as error:
            problem = f"is not a checkpoint of this scene: {error}"
            raise SceneError(checkpoint.name, problem) from None
        self.counts = self.simulation.counts()
        self.ledger.clear()
        self._observe(self._box())

    def gravity(self) -> tuple[float, float, float]:
        """Returns gravity [m/s^2] in the pool's frame now, without user input."""
        self.pose.take(Inputs(), self.simulation.time)
        return self._box().gravity

    def reset(self) -> None:
        """Resets the simulation; the camera stays."""
        self.simulation.reset()
        self.resets += 1
        self.pose.reset(self.simulation.time)
        if self.draws:
            self.display.reset()
        self.stopped.clear()
        self.counts = self.simulation.counts()
        self.ledger.clear()
        self.simulated = 0.0
        self.tools.reset()
        self._observe(self._box())

    def _observe(self, external: MovingBox) -> None:
        """Collects the numbers of the present frame."""
        sim, last = self.simulation, self.ledger.entries[-1] if self.ledger.entries else None
        # The residual is not measured in every frame.
        residual = last.solver_residual_mean if last else math.nan
        self.now = Moment(
            time=sim.time,
            simulated=self.simulated,
            tilt=self.pose.tilt,
            shift=self.pose.shift,
            gravity=external.gravity,
            hand=external.hand,
            top_speed=last.top_speed if last else 0.0,
            ball=self.tools.ball,
            spilt=sim.rim.mass,
            energy=last.energy if last else math.nan,
            solver_residual=self.now.solver_residual if last and math.isnan(residual) else residual,
            fluid=self.timings.spent("fluid"),
            resets=self.resets,
            stopped=frozenset(self.stopped),
            waiting=sim.openings.message() or "",
        )

    def take(self) -> None:
        """Copies the present particles and bodies to the state."""
        views = self.display.views if self.size else None
        wanted = [views.wanted] if views else []
        self.state.take(self.simulation, self.now, *wanted)

    def draw(self) -> None:
        """Draws the simulation as it is now."""
        self.take()
        self.display.draw()

    def extracted(self) -> SurfaceMesh:
        self.take()
        return super().extracted()

    def snapshot(self, probes: list[Probe]) -> Snapshot:
        """Returns the water as probes read it; before the first step with the pressures of water
        that starts from rest."""
        water, box = Snapshot.of(self.simulation), self._box()
        if water.pressure is not None or not any(probe.PRESSURE for probe in probes):
            return water
        external = box.at(box.start, self.frame_time)
        centre = 0.5 * np.array(self.simulation.size)
        return with_first_pressures(water, self.scene.density, external, centre)

    def water(self) -> Snapshot:
        return Snapshot.of(self.simulation)

    def rest_volume(self) -> float:
        """Returns the volume of all particles at rest density [m^3]."""
        specs = self.simulation.layers.specs
        return sum(n * s.volume for n, s in zip(self.simulation.counts(), specs, strict=True))

    def pace(self) -> str:
        """Returns the number of steps so far, their length, and the parameter that limits it."""
        sim = self.simulation
        bounds = sim.solver.step_bounds()
        key = min(bounds, key=lambda name: bounds[name])
        limit = f"limited by {self.scene.method}.{key}"
        return f"steps so far {sim.steps:,}, of {sim.last_step:.2g} s each, {limit}"
