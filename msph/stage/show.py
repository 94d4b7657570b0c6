"""Show: simulation, surface, image and ledger of one scene, advanced frame by frame."""

import math
from collections.abc import Callable
from copy import copy
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from msph.fluid.boundary.rigid_bodies import Body, rotations
from msph.fluid.boundary.rim import AllSpiltError
from msph.fluid.external_forces import Hand, Vec3, rotation_vector
from msph.fluid.moving_box import MovingBox
from msph.fluid.simulation import FullError
from msph.fluid.stages import Stage, no_stage
from msph.fluid.trapped_water import TrappedWaterError
from msph.measure.bulk import bulk_density
from msph.measure.ledger import Ledger
from msph.measure.past import UNREADABLE
from msph.measure.snapshot import Snapshot
from msph.measure.timings import Timings
from msph.picture.camera import Camera
from msph.picture.picture import Picture, picture_of
from msph.picture.pixels import matted
from msph.picture.room import PictureRoom
from msph.scene.build import build_simulation
from msph.scene.camera_path import orbit_at
from msph.scene.errors import SceneError
from msph.scene.live import live_parameters, read, with_live_value
from msph.scene.motion import box_path
from msph.scene.parts import value_of, with_value
from msph.scene.schema import Scene
from msph.stage import pistons
from msph.stage.controls import Controls, Inputs
from msph.stage.floats import floating_at
from msph.stage.tools import BY_NAME, ToolUse, Touch
from msph.stage.views import Views
from msph.surface import Surface, SurfaceRoom, surface_of
from msph.surface.whitewater import whitewater_of

# Key of a checkpoint under which a session in a window describes itself.
SESSION = "session"
# Image scale of the warm-up frame (-); below 1, so that the enlarging kernels compile, too.
WARM_UP_SCALE = 0.5
# The first step after a start differs from later ones.
WARM_UP_FRAMES = 2

# Gravity for the speeds of tools in weightless scenes [m/s^2].
LEAST_GRAVITY = 1.0

# Options of an interactive show on which the simulation depends, and all. Solver residuals are
# measured only every 0.1 s, since they need a neighbour search.
SIMULATED: dict[str, Any] = {"stop_bodies": True, "spare": 2000}
INTERACTIVE: dict[str, Any] = {**SIMULATED, "scalable": True, "density_every": 0.1}


class Show:
    """Simulation with surface, image and ledger, advanced frame by frame.

    frame_time [s]: default simulated time of a frame. size (width, height) [pixels] of the image,
    None for no image. meshes: extract the surface of every frame, rendered or not. density_every
    [s]: see Ledger. stop_bodies: no error ends the show where a body traps water, which stops the
    body, or where all water is spilt, which begins the scene again; stopped: names of such bodies.
    scalable: frames may set the image scale. simulated [s]: time simulated by the last frame.
    spare, room: see build_simulation. Unused parts are neither allocated nor compiled.
    """

    def __init__(
        self,
        scene: Scene,
        frame_time: float,
        size: tuple[int, int] | None = None,
        meshes: bool = False,
        timings: Timings | None = None,
        clock: Callable[[], float] = perf_counter,
        density_every: float = 0.0,
        stop_bodies: bool = False,
        scalable: bool = False,
        spare: int = 0,
        room: int = 0,
    ):
        self.scene = self.initial = scene
        # Keys of the live parameters; a viscosity set to 0 remains live.
        self.live = {live.key for live in live_parameters(scene)}
        self.frame_time = frame_time
        self.timings = timings
        self.clock = clock
        self.simulated = 0.0
        # Called after each step with the completed share (0 to 1) of its frame.
        self.on_progress: Callable[[float], None] | None = None
        self.stop_bodies, self.scalable = stop_bodies, scalable and size is not None
        self.stopped: set[str] = set()
        self.note = ""  # message to the user about the last frame
        # Floating body that the user drags: its index, and its centre from the cursor [m].
        self.dragged: tuple[int, np.ndarray] | None = None
        # While the user drags an end wall: its place [m] at the press and the longest way [m]; its
        # place in this frame.
        self.grip: tuple[float, float] | None = None
        self.wall_place: float | None = None
        self.simulation = build_simulation(scene, spare, room)
        self.counts = self.simulation.counts()
        self.ledger = Ledger(self.simulation, density_every)
        self.frames = 0
        self.path = box_path(scene)
        # Rotation of the box and displacement of its centre [m], in world axes.
        self.tilt, self.shift = np.eye(3), np.zeros(3)
        self.rng = np.random.default_rng(scene.seed)  # of drops that the user adds
        # The user's tilt of the present frame and of the last one, None if it has none to turn
        # from; its angular velocity [rad/s] in world axes.
        self.by_hand: np.ndarray = np.eye(3)
        self.turned: np.ndarray | None = None
        self.turning: Any = np.zeros(3)
        self.meshes = meshes
        # Unused parts are None.
        self.surface: Any = self._load_surface() if size or meshes else None
        self.picture: Any = self._load_picture(size) if size else None
        self.views: Any = Views(self.simulation, scene) if size else None
        world, white = self.simulation.world, size and scene.picture.whitewater
        self.whitewater: Any = world.build_once(whitewater_of) if white else None
        if self.whitewater:
            self.whitewater.reset()
        if size:
            self.camera = self.framing()

    def framing(self, free: float = 1.0, stretch: float = 1.0) -> Camera:
        """Returns the scene's camera now, with the box within the right share `free` of the image;
        stretch: see Camera."""
        c, picture = self.scene.camera, self.picture
        x, y, z = self.scene.box.size
        centre = 0.5 * x, 0.5 * y, 0.5 * z
        azimuth, elevation, zoom, target = orbit_at(c, self.simulation.time, centre)
        camera = Camera.framing(
            self.scene.box.size,
            aspect=free * stretch * picture.width / picture.height,
            azimuth=math.radians(azimuth),
            elevation=math.radians(elevation),
            fov=math.radians(c.fov),
        )
        camera.target = np.array(target)
        camera.zoom(1.0 / zoom)
        camera.shift, camera.stretch = 0.5 * (1.0 - free), stretch
        return camera

    def set(self, key: str, value: float | None) -> None:
        """Sets a live parameter (msph/scene/live.py), None for its initial value; parameters that
        this scene does not have are ignored."""
        if key not in self.live:
            return
        if value is None:
            self.scene = with_value(self.scene, key, value_of(self.initial, key))
        else:
            self.scene = with_live_value(self.scene, key, value)
        if key.startswith("picture.") and self.picture:
            self.picture.change(self.scene.picture)
        if key.startswith(f"{self.scene.method}."):
            self.simulation.solver.tune(getattr(self.scene, self.scene.method))

    def changes(self) -> dict[str, float]:
        """Returns the live parameters that differ from their initial values."""
        values = {key: (read(self.scene, key), read(self.initial, key)) for key in self.live}
        return {key: now for key, (now, before) in values.items() if now != before}

    def _load_surface(self) -> Surface:
        s, sim = self.scene.surface, self.simulation
        cell = s.cell * sim.layers.finest.spacing
        room = SurfaceRoom.holding(sim.region, cell, sim.particles.capacity)
        surface = sim.world.build_once(surface_of, room)
        surface.load(sim.region, cell, s.smoothing)
        self.shown_bodies = sim.boundary.count
        return surface

    def _load_picture(self, size: tuple[int, int]) -> Picture:
        look = self.scene.picture
        sim, room = self.simulation, PictureRoom.holding(*size, look.supersample)
        picture = sim.world.build_once(picture_of, self.surface.room, room)
        spacing = max(self.surface.lattice.spacing)
        picture.load(*size, sim.size, look, sim.region, spacing)
        return picture

    def warm_up(self) -> None:
        """Compiles the kernels of a frame by running two of a step each, and those of the particle
        views of an interactive show, and resets."""
        # The hand is visible, and too slow to move anything before the reset.
        push = ToolUse.of(BY_NAME["push"], (np.zeros(3),) * 5, self.frame_time, 1.0)
        for _ in range(WARM_UP_FRAMES):
            self.frame(Controls(use=push, scale=WARM_UP_SCALE, budget=0.0))
        if self.scalable:
            # A first change of the view, the first autosave, and the first water that is added
            # should not wait for kernels.
            name = self.views.name
            self.views.next()
            self.draw()
            self.views.name = name
            self.simulation.state()
            self.simulation.particles.extend(np.zeros((0, 3)), np.zeros((0, 3)), 0)
        self.reset()
        self.frames = 0
        if self.timings:
            self.timings.discard()

    def close(self) -> None:
        """Drops all parts, so that another simulation can use their memory."""
        self.simulation.close()
        for part in ("simulation", "ledger", "surface", "picture", "views", "whitewater"):
            setattr(self, part, None)

    def frame(self, controls: Controls) -> None:
        """Runs one frame: controls, fluid, ledger, surface, image."""
        for key, value in controls.set.items():
            self.set(key, value)
        if controls.reset:
            self.reset()
        if controls.next_view and self.views:
            self.views.next()
        external, self.simulated = self._moving_box(controls), 0.0
        if not controls.still:
            with self._stage("fluid"):
                self.simulated = self._advance(controls, external)
                if self.simulation.openings.waiting:
                    self.note = self.simulation.openings.message() or ""
            if self.simulated > 0.0:
                self._place()
                self.ledger.record(external.gravity)
                if self.whitewater:
                    with self._stage("surface"), self._substage("whitewater"):
                        self.whitewater.advance(self.simulated, external.gravity)
                if self.picture:
                    with self._stage("picture"):
                        self.picture.advance(self.simulated, external.hand)
        if self.scalable:
            self.picture.scale = controls.scale
        elif self.picture and self.scene.camera.path:
            self.camera = self.framing()
        if not controls.hidden:
            self.draw()
        self.frames += 1
        if self.timings:
            self.timings.close_frame()

    def _advance(self, controls: Controls, external: MovingBox) -> float:
        """Advances the fluid by a frame and returns the simulated time [s]. With stop_bodies, a
        frame in which a body traps water is undone, and the body stops a frame earlier; and the
        scene begins again when all water is spilt."""
        sim, frame_time = self.simulation, controls.frame_time or self.frame_time
        before = sim.state() if self.stop_bodies and sim.boundary.driven else None
        try:
            return sim.advance(
                frame_time,
                external,
                self._substage,
                controls.budget,
                self.clock,
                self.on_progress,
                controls.until,
            )
        except AllSpiltError as error:
            if not self.stop_bodies:
                raise
            self.reset()
            self.note = f"{error}: the scene begins again"
            return 0.0
        except TrappedWaterError as error:
            if before is None:
                raise
            stopped = dict(sim.boundary.stopped)
            by_wall = sim.boundary.bodies[error.body].motion is sim.piston
            sim.restore(before)
            if by_wall:
                sim.remove_piston()
                self.note = f"{error.name} is gone: it had trapped water"
                return 0.0
            # Repeated stops of a body move it back farther: the compressed water needs room.
            stopped[error.body] = min(sim.time, stopped.get(error.body, sim.time)) - frame_time
            self._stop(stopped)
            self.stopped.add(error.name)
            return 0.0

    def _stop(self, stopped: dict[int, float]) -> None:
        """Stops bodies, given as number: time of the stop [s]."""
        boundary, time = self.simulation.boundary, self.simulation.time
        for body, since in stopped.items():
            boundary.stop(body, since)
        boundary.place(time, 0.0)

    def _moving_box(self, controls: Controls) -> MovingBox:
        """Sets the tilt, uses the tool, and returns the external forces of the frame: gravity,
        hand, and the inertia of the scene's motion and of the user's tilt."""
        by_hand = self._tilt(controls)
        box = self._box()
        if self.picture:
            self.picture.ball = None
        if controls.still:
            # A pool that is tilted meanwhile does not turn at once; a pause alone changes nothing.
            if self.turned is not None and not np.array_equal(by_hand, self.turned):
                self.turned = None
            return box
        hand = self._use_tool(controls.use) if controls.use else controls.hand
        step, before = controls.frame_time or self.frame_time, self.turning
        pistons.follow(self, step)
        last = by_hand if self.turned is None else self.turned
        self.turned, self.turning = by_hand, rotation_vector(by_hand @ last.T) / step
        rising = (self.turning - before) / step
        return replace(box, hand=hand, turning=self.turning, rising=rising)

    def _box(self) -> MovingBox:
        """Returns the moving box now, without a hand and without a turn by the user."""
        return MovingBox(self.scene.gravity, self.path, self.simulation.time, tilt=self.by_hand)

    def _use_tool(self, use: ToolUse) -> Hand:
        """Returns the hand of a tool, which may also add water."""
        tool, touch = BY_NAME[use.tool], Touch(self, use)
        if tool.ball and self.picture:
            self.picture.ball = use.place, touch.radius
        try:
            return tool.act(touch)
        except FullError as error:
            self.note = str(error)
            return Hand()

    def _tilt(self, inputs: Inputs) -> np.ndarray:
        """Sets the user's tilt, and returns it, (3, 3)."""
        roll, pitch = inputs.tilt
        vectors = (0.0, inputs.azimuth, 0.0), (0.0, 0.0, roll), (pitch, 0.0, 0.0)
        view, first, then = rotations(np.array(vectors))
        self.by_hand = view @ then @ first @ view.T
        self._place()
        return self.by_hand

    def _place(self) -> None:
        """Sets the pose of the box to that of the present time."""
        self.shift, turned = self.path(self.simulation.time)
        self.tilt = self.by_hand @ turned

    @property
    def view(self) -> Camera:
        """The camera in axes that move with the box's centre."""
        camera = copy(self.camera)
        camera.target = camera.target - self.shift
        return camera

    def add_water(self, x: np.ndarray, v: np.ndarray) -> None:
        """Adds particles of the finest layer at x [m] with velocities v [m/s], (n, 3), where there
        is room. Raises FullError."""
        sim = self.simulation
        finest = int(np.argmin([spec.mass for spec in sim.layers.specs]))
        sim.add(x.astype(np.float32), v.astype(np.float32), finest, self.gravity_in_box())

    def add_body(self, body: Body) -> None:
        """Adds a floating body until the next reset. Raises FullError."""
        self.simulation.add_body(body, self.gravity_in_box())

    @property
    def tool_gravity(self) -> float:
        """Absolute value of gravity [m/s^2] for the speeds of tools."""
        return max(math.hypot(*self.scene.gravity), LEAST_GRAVITY)

    def gravity_in_box(self) -> Vec3:
        """Returns gravity [m/s^2] in the pool's frame, tilted as it is."""
        return self._box().gravity

    def draw(self) -> None:
        """Extracts the surface and renders the image, as far as they are used."""
        if self.surface and self.shown_bodies != self.simulation.boundary.count:
            self._load_surface()
            if self.picture:
                self.picture.take_bodies()
        water = self.picture is not None and self.views.name == "water"
        if self.surface and (water or self.meshes):
            with self._stage("surface"):
                self.surface.extract(hidden=not self.meshes)
        if self.picture:
            self._render()

    def matted_image(self) -> np.ndarray:
        """Renders the last image again, (height, width, 4) uint8, with its opacity."""
        shown = []
        for level in (0.0, 1.0):
            plain = {"background": (level,) * 3, "background_top": None}
            self.picture.change(self.scene.picture.model_copy(update=plain))
            self._render()
            shown.append(self.picture.to_numpy_u8())
        self.picture.change(self.scene.picture)
        return matted(*shown)

    def _render(self) -> None:
        """Renders the surface, or the particles."""
        with self._stage("picture"):
            if self.views.name == "water":
                self.picture.draw_water(self.view, self.tilt)
            else:
                sim = self.simulation
                self.views.neighbourhood.follow()
                if self.views.cut is not None:
                    self.views.cut = self._near()
                value, lo, hi = self.views.values()
                self.picture.draw_particles(
                    self.view,
                    self.tilt,
                    sim.particles.x,
                    value,
                    lo,
                    hi,
                    sim.particles.count,
                    self.views.radius,
                    legend=self.views.legend(lo, hi),
                )

    @property
    def _substage(self) -> Stage:
        """Timer of the parts of a step."""
        return self.timings.substage if self.timings else no_stage

    @property
    def _stage(self) -> Stage:
        """Timer of the stages of a frame."""
        return self.timings.stage if self.timings else no_stage

    def resume(self, checkpoint: Path) -> None:
        """Continues from a checkpoint, a .npz file of Simulation.state(). Raises SceneError."""
        try:
            with np.load(checkpoint) as state:
                self.simulation.restore({k: state[k] for k in state if k != SESSION})
        except UNREADABLE as error:
            problem = f"is not a checkpoint of this scene: {error}"
            raise SceneError(checkpoint.name, problem) from None
        self.counts = self.simulation.counts()
        self.ledger.clear()

    def gravity(self) -> tuple[float, float, float]:
        """Returns gravity [m/s^2] in the pool's frame now, without user input."""
        self._tilt(Inputs())
        return self._box().gravity

    def reset(self) -> None:
        """Resets the simulation; the camera stays."""
        self.simulation.reset()
        self._place()
        self.turned, self.turning = None, np.zeros(3)
        if self.whitewater:
            self.whitewater.reset()
        if self.picture:
            self.picture.reset()
        self.stopped.clear()
        self.dragged = self.grip = self.wall_place = None
        self.counts = self.simulation.counts()
        self.ledger.clear()

    def pick(self, i: int, j: int) -> np.ndarray | None:
        """Returns the point of the water or of a floating body [m], box frame, at a pixel (i right,
        j up), or None."""
        if self.views.name == "water":
            water, (eye, direction) = self.picture.pick(i, j), self.ray(i, j)
            body = floating_at(self.simulation.boundary, eye, direction)
            hits = [x for x in (water, body[1] if body else None) if x is not None]
            return min(hits, key=lambda x: float((x - eye) @ direction), default=None)
        found = self.particle_at(i, j)
        return None if found is None else found[1]

    def ray(self, i: float, j: float) -> tuple[np.ndarray, np.ndarray]:
        """Returns origin [m] and direction of a pixel's ray in the box frame."""
        width, height = self.picture.size
        return self.view.box_ray(i, j, width, height, self.simulation.size, self.tilt)

    def particle_at(self, i: int, j: int) -> tuple[int, np.ndarray] | None:
        """Returns the nearest visible particle at a pixel (i right, j up), as its index and the
        point of the ray closest to its centre [m]; None if there is no particle."""
        eye, direction = self.ray(i, j)
        x = self.simulation.particles.numpy("x") - eye
        depth = x @ direction
        aside = np.linalg.norm(x - depth[:, None] * direction, axis=1)
        radius = self.views.radii()
        hit = np.flatnonzero((aside < radius) & (depth > 0.0))
        if len(hit) == 0:
            return None
        first = int(hit[depth[hit].argmin()])
        return first, eye + depth[first] * direction

    def slice(self) -> None:
        """Hides the half of the particles nearer to the camera, or shows it again."""
        self.views.cut = None if self.views.cut is not None else self._near()

    def _near(self) -> np.ndarray:
        """Returns the horizontal unit vector to the camera, (3,), in the box frame."""
        back = self.camera.axes()[2] * (1.0, 0.0, 1.0)
        return self.tilt.T @ (back / np.linalg.norm(back))

    def volume(self) -> float:
        """Returns the volume enclosed by the surface mesh [m^3]; NaN if the mesh overflowed."""
        self.surface = self.surface or self._load_surface()
        self.simulation.grid.refresh()
        self.surface.extract()
        mesh = self.surface.mesh
        return math.nan if mesh.overflowed() else mesh.volume()

    def volume_error(self) -> float:
        """Returns the surface's volume over the volume at rest density, minus 1 (-)."""
        return self.volume() / self.rest_volume() - 1.0

    def bulk_density_error(self) -> float:
        """Returns the error of the bulk density (-), measured from the positions in milliseconds;
        NaN if the water is too thin."""
        water = Snapshot.of(self.simulation)
        return bulk_density(water.x, water.spacing, water.size, water.free).mean - 1.0

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

    def warnings(self) -> list[str]:
        """Returns warnings about a truncated mesh, waiting inflows and stopped bodies."""
        overflow = self.surface.mesh.overflowed() if self.surface else None
        told = [text for text in (overflow, self.simulation.openings.message()) if text]
        return [*told, *(f"{name} stopped: it had trapped water" for name in sorted(self.stopped))]
