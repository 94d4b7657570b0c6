"""A show: one scene's fluid, surface, picture and ledger, advanced frame by frame."""

import math
from collections.abc import Callable
from copy import copy
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from msph.fluid.external_forces import ExternalForces
from msph.fluid.stages import Stage, no_stage
from msph.fluid.trapped_water import TrappedWaterError
from msph.measure.ledger import Ledger
from msph.measure.past import UNREADABLE
from msph.measure.timings import Timings
from msph.picture.camera import Camera
from msph.picture.picture import Picture, picture_of
from msph.picture.room import PictureRoom
from msph.scene.build import (
    build_simulation,
    rotation,
    sway_angle,
    turn,
)
from msph.scene.errors import SceneError
from msph.scene.live import changed
from msph.scene.schema import Scene
from msph.stage.controls import Controls
from msph.stage.views import Views
from msph.surface import Surface, SurfaceRoom, surface_of

# Scale of the image while kernels are compiled (-).
WARM_UP_SCALE = 0.5

# Options of a show that someone plays with. Density errors, which no frame needs, are measured
# every tenth of a second [s], often enough to be read: they take a list of neighbours and a sum.
INTERACTIVE: dict[str, Any] = {"stop_bodies": True, "scalable": True, "density_every": 0.1}


class Show:
    """Everything that a frame needs, built once.

    frame_time [s] is the simulated time of a frame that asks for no other. size (width, height)
    [pixels] of the picture, None for no picture. meshes: whether someone wants the surface even if
    no view draws it. density_every [s]: as of a Ledger.
    stop_bodies: whether a body that leaves the water no room stops, in place of an error; stopped
    are the names of those that did. scalable: whether frames may ask for a coarser picture.
    simulated [s] is what the last frame really simulated. What is not asked for is neither
    allocated nor compiled.
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
    ):
        self.scene = scene
        self.frame_time = frame_time
        self.timings = timings
        self.clock = clock
        self.simulated = 0.0
        # Called after each step with the share (0 to 1) of its frame that is over.
        self.on_progress: Callable[[float], None] | None = None
        self.stop_bodies, self.scalable = stop_bodies, scalable and size is not None
        self.stopped: set[str] = set()
        self.simulation = build_simulation(scene)
        self.counts = self.simulation.counts()
        self.ledger = Ledger(self.simulation, density_every)
        self.frames = 0
        self.tilt = np.eye(3)
        self.meshes = meshes
        # Each is None where nobody asked for it.
        self.surface: Any = self._load_surface() if size or meshes else None
        self.picture: Any = self._load_picture(size) if size else None
        self.views: Any = Views(self.simulation, scene) if size else None
        if size:
            self.camera = self.framing()

    def framing(self, free: float = 1.0, stretch: float = 1.0) -> Camera:
        """The scene's own point of view, in which the box is within the right share `free` of the
        picture, on a screen of `stretch` (see Camera)."""
        c, picture = self.scene.camera, self.picture
        camera = Camera.framing(
            self.scene.box.size,
            aspect=free * stretch * picture.width / picture.height,
            azimuth=math.radians(c.azimuth),
            elevation=math.radians(c.elevation),
            fov=math.radians(c.fov),
        )
        camera.zoom(1.0 / c.zoom)
        camera.shift, camera.stretch = 0.5 * (1.0 - free), stretch
        return camera

    def set(self, key: str, value: float) -> None:
        """Changes a live parameter of the scene (msph.scene.live)."""
        self.scene = changed(self.scene, key, value)
        if key.startswith("picture.") and self.picture:
            self.picture.change(self.scene.picture)
        if key.startswith(f"{self.scene.method}."):
            self.simulation.solver.tune(getattr(self.scene, self.scene.method))

    def _load_surface(self) -> Surface:
        s, sim = self.scene.surface, self.simulation
        cell = s.cell * sim.layers.finest.spacing
        room = SurfaceRoom.holding(sim.size, cell, sim.particles.capacity)
        surface = sim.world.once(surface_of, room)
        surface.load(sim.size, cell, s.smoothing)
        return surface

    def _load_picture(self, size: tuple[int, int]) -> Picture:
        look = self.scene.picture
        sim, room = self.simulation, PictureRoom.holding(*size, look.supersample)
        picture = sim.world.once(picture_of, self.surface.room, room)
        picture.load(*size, sim.size, look)
        return picture

    def warm_up(self) -> None:
        """Compiles the kernels of a frame by one of them, and resets."""
        # A coarser image, where the show is scalable, is enlarged by kernels of its own.
        self.frame(Controls(scale=WARM_UP_SCALE))
        self.reset()
        self.frames = 0
        if self.timings:
            self.timings.discard()

    def close(self) -> None:
        """Drops all parts, and lets another simulation use their memory."""
        self.simulation.close()
        for part in ("simulation", "ledger", "surface", "picture", "views"):
            setattr(self, part, None)

    def frame(self, controls: Controls) -> None:
        """Controls, fluid, ledger, surface, picture: in this order, once."""
        if controls.reset:
            self.reset()
        if controls.next_view and self.views:
            self.views.next()
        external = self._force(controls)
        if not controls.paused or controls.single_step:
            with self._stage("fluid"):
                frame_time = controls.frame_time or self.frame_time
                self.simulated = self._advance(frame_time, external, controls.budget)
            if self.simulated > 0.0:
                self.ledger.record(external.gravity)
        if self.scalable:
            self.picture.scale = controls.scale
        self.draw()
        self.frames += 1
        if self.timings:
            self.timings.close_frame()

    def _advance(self, frame_time: float, external: ExternalForces, budget: float | None) -> float:
        """A frame of the fluid; returns its simulated time [s]. One in which a body leaves the
        water no room is given up: the body goes back by a frame, and stays there."""
        sim = self.simulation
        before = sim.state() if self.stop_bodies and sim.boundary.moving else None
        try:
            return sim.advance(
                frame_time, external, self._substage, budget, self.clock, self.on_progress
            )
        except TrappedWaterError as error:
            if before is None:
                raise
            stopped = dict(sim.boundary.stopped)
            sim.restore(before)
            # What it pressed before needs room again: back farther each time.
            stopped[error.body] = min(sim.time, stopped.get(error.body, sim.time)) - frame_time
            self._stop(stopped)
            self.stopped.add(error.name)
            return 0.0

    def _stop(self, stopped: dict[int, float]) -> None:
        """Bodies by number, and when [s] they stopped."""
        boundary, time = self.simulation.boundary, self.simulation.time
        for body, since in stopped.items():
            boundary.stop(body, since)
        boundary.place(time, 0.0)

    def moment(self) -> dict[str, Any]:
        """What is seen now: the water, the bodies that stopped, tilt, point of view."""
        return {
            "state": self.simulation.state(),
            "stopped": dict(self.simulation.boundary.stopped),
            "tilt": self.tilt.copy(),
            "camera": copy(self.camera),
            "view": self.views.name,
        }

    def show_moment(self, moment: dict[str, Any]) -> None:
        """Goes back to a moment(), and draws it."""
        self.simulation.restore(moment["state"])
        self._stop(moment["stopped"])
        self.tilt, self.camera = moment["tilt"], moment["camera"]
        self.views.name = moment["view"]
        self.simulation.grid.refresh()
        self.draw()

    def _force(self, controls: Controls) -> ExternalForces:
        """The pool turns and gravity stays: in the pool's frame gravity turns the other way."""
        # Keys tilt as seen: right and away are the camera's, on the horizon.
        view = turn(self.camera.azimuth) if self.picture else np.eye(3)
        by_hand = view @ rotation(*controls.tilt) @ view.T
        self.tilt = by_hand @ rotation(sway_angle(self.scene, self.simulation.time), 0.0)
        gx, gy, gz = (self.tilt.T @ np.array(self.scene.gravity)).tolist()
        return ExternalForces((gx, gy, gz), controls.hand)

    def draw(self) -> None:
        """Extracts the surface and draws the picture, as far as anyone wants them."""
        water = self.picture is not None and self.views.name == "water"
        if self.surface and (water or self.meshes):
            with self._stage("surface"):
                self.surface.extract()
        if self.picture is None:
            return
        with self._stage("picture"):
            if water:
                self.picture.draw_water(self.camera, self.tilt)
            else:
                sim = self.simulation
                self.views.neighbourhood.follow()
                if self.views.cut is not None:
                    self.views.cut = self._near()
                value, lo, hi = self.views.values()
                self.picture.draw_particles(
                    self.camera,
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
        """Of the parts of a step."""
        return self.timings.substage if self.timings else no_stage

    @property
    def _stage(self) -> Stage:
        if self.timings:
            return self.timings.stage
        return no_stage

    def resume(self, checkpoint: Path) -> None:
        """Goes on from a checkpoint, a .npz file of Simulation.state(). Raises SceneError."""
        try:
            with np.load(checkpoint) as state:
                self.simulation.restore(dict(state))
        except UNREADABLE as error:
            raise SceneError(checkpoint.name, f"is no checkpoint of this scene: {error}") from None
        self.counts = self.simulation.counts()
        self.ledger.clear()

    def gravity(self) -> tuple[float, float, float]:
        """Gravity [m/s^2] in the pool's frame as the scene has it now, untouched by anyone."""
        return self._force(Controls()).gravity

    def reset(self) -> None:
        """Back to the scene's start; the point of view stays."""
        self.simulation.reset()
        self.stopped.clear()
        self.counts = self.simulation.counts()
        self.ledger.clear()

    def pick(self, i: int, j: int) -> np.ndarray | None:
        """Point of the water [m], box frame, seen under the pixel (i right, j up), or None."""
        if self.views.name == "water":
            return self.picture.pick(i, j)
        found = self.particle_at(i, j)
        return None if found is None else found[1]

    def particle_at(self, i: int, j: int) -> tuple[int, np.ndarray] | None:
        """The nearest particle that is seen under a pixel, its place in the pool, and the point [m]
        on the way to it that is nearest to its centre; None where none is."""
        size, sim = (self.picture.width, self.picture.height), self.simulation
        eye, direction = self.camera.box_ray(i, j, *size, sim.size, self.tilt)
        x = sim.particles.numpy("x") - eye
        depth = x @ direction
        aside = np.linalg.norm(x - depth[:, None] * direction, axis=1)
        radius = self.views.radii()
        seen = np.flatnonzero((aside < radius) & (depth > 0.0))
        if len(seen) == 0:
            return None
        first = int(seen[depth[seen].argmin()])
        return first, eye + depth[first] * direction

    def slice(self) -> None:
        """Hides the near half of the particles, as the camera goes, or shows it again."""
        self.views.cut = None if self.views.cut is not None else self._near()

    def _near(self) -> np.ndarray:
        """Horizontal unit vector to the camera, (3,), in the box's frame."""
        back = self.camera.axes()[2] * (1.0, 0.0, 1.0)
        return self.tilt.T @ (back / np.linalg.norm(back))

    def volume(self) -> float:
        """Volume [m^3] that the surface encloses now; NaN where its mesh overflowed.

        The mesh is closed along the walls too, so the divergence theorem needs nothing else.
        """
        self.surface = self.surface or self._load_surface()
        self.simulation.grid.refresh()
        self.surface.extract()
        mesh = self.surface.mesh
        return math.nan if mesh.overflowed() else mesh.volume()

    def volume_error(self) -> float:
        """Volume of the surface over the volume of the water at rest density, less one (-)."""
        return self.volume() / self.rest_volume() - 1.0

    def rest_volume(self) -> float:
        """Volume [m^3] of the water at rest density."""
        specs = self.simulation.layers.specs
        return sum(n * s.volume for n, s in zip(self.simulation.counts(), specs, strict=True))

    def warnings(self) -> list[str]:
        """What went short and was cut, in words."""
        overflow = self.surface.mesh.overflowed() if self.surface else None
        stopped = [f"{name} stopped: its water had nowhere to go" for name in sorted(self.stopped)]
        return [*([overflow] if overflow else []), *stopped]
