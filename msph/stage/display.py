"""Display: surface, image, views and camera of one simulation."""

import math
from collections.abc import Callable
from copy import copy
from typing import Any

import numpy as np

from msph.picture.camera import Camera
from msph.picture.picture import Picture, picture_of
from msph.picture.pixels import matted
from msph.picture.room import PictureRoom
from msph.scene.camera_path import orbit_at
from msph.stage.controls import Controls
from msph.stage.floats import floating_at
from msph.stage.shown_scene import ShownScene
from msph.stage.views import Views
from msph.surface import Surface, SurfaceRoom, surface_of
from msph.surface.mesh import SurfaceMesh
from msph.surface.whitewater import whitewater_of

# `below` of Camera.framing: leaves room for a window's line of hints below the box.
BELOW = 1.2


class Display:
    """Extracts the surface of a show's state and renders it, or its particles.

    size (width, height) [pixels] of the image, None for no image. meshes: extract the surface of
    every frame, rendered or not. Frames of interactive shows set the image scale. Parts that are
    not used are None.
    """

    def __init__(self, show: ShownScene, size: tuple[int, int] | None, meshes: bool = False):
        self.state, self.scene, self.meshes = show.state, show.initial, meshes
        self.scalable = show.interactive
        self.stage, self.substage = show.timings.stage, show.timings.substage
        # True if the spray is droplets, as in images, instead of a part of the mesh.
        self.sprayed = not meshes
        self.surface: Any = None
        self.picture: Any = None
        self.views: Any = None
        self.whitewater: Any = None
        self.shown: Any = None  # the moment of the last image of water
        self.load(size)

    def load(self, size: tuple[int, int] | None) -> None:
        """Loads the parts for images of `size` (width, height) [pixels], None for no images."""
        self.unfinished = False  # True if the mesh is incomplete, since a drawing ended early
        self.prepared = False  # True if the kernels for bodies are compiled
        self.surface = self._load_surface() if size or self.meshes else None
        self.picture = self._load_picture(size) if size else None
        self.views = Views(self.state, self.scene) if size else None
        white = self.surface and self.scene.picture.whitewater
        self.whitewater = self.state.build_once(whitewater_of) if white else None
        for part in (self.surface, self.whitewater):  # both may hold the state of other water
            if part:
                part.reset()
        if size:
            self.camera = self.framing()

    def framing(
        self, free: float = 1.0, stretch: float = 1.0, aspect: float | None = None
    ) -> Camera:
        """Returns the scene's camera now, with the box within the right share `free` of the image;
        stretch: see Camera; aspect: width over height of the image, by default of the picture."""
        c = self.scene.camera
        aspect = aspect or self.picture.width / self.picture.height
        x, y, z = self.scene.box.size
        centre = 0.5 * x, 0.5 * y, 0.5 * z
        azimuth, elevation, zoom, target = orbit_at(c, self.state.now.time, centre)
        camera = Camera.framing(
            self.scene.box.size,
            aspect=free * stretch * aspect,
            azimuth=math.radians(azimuth),
            elevation=math.radians(elevation),
            fov=math.radians(c.fov),
            below=BELOW,
        )
        camera.target = np.array(target)
        camera.zoom(1.0 / zoom)
        camera.shift, camera.stretch = 0.5 * (1.0 - free), stretch
        return camera

    def _load_surface(self) -> Surface:
        s, state = self.scene.surface, self.state
        cell = s.cell * state.layers.finest.spacing
        room = SurfaceRoom.holding(state.region, cell, state.particles.capacity)
        surface = state.build_once(surface_of, room)
        surface.load(state.region, cell, s.smoothing)
        self.shown_bodies = state.boundary.count
        return surface

    def _load_picture(self, size: tuple[int, int]) -> Picture:
        look = self.scene.picture
        state, room = self.state, PictureRoom.holding(*size, look.supersample)
        picture = state.build_once(picture_of, self.surface.room, room)
        spacing = max(self.surface.lattice.spacing)
        picture.load(*size, state.plan.size, look, state.region, spacing)
        return picture

    def frame(self, controls: Controls, new: bool = True) -> None:
        """Draws a frame: of a `new` state, or anew of the last state."""
        if new and self.state.now.simulated > 0.0:
            self.advance()
        if self.scalable:
            self.picture.scale = controls.scale
        elif self.picture and self.scene.camera.path:
            self.camera = self.framing()
        if not controls.hidden:
            self.draw(new)

    def advance(self) -> None:
        """Advances spray, whitewater, ripples and wetness by the simulated time of the frame."""
        now = self.state.now
        if self.surface:
            self.surface.advance(now.simulated)
        if self.whitewater:
            with self.stage("surface"), self.substage("whitewater"):
                self.whitewater.advance(now.simulated, now.gravity, now.top_speed)
        if self.picture:
            with self.stage("picture"):
                self.picture.advance(now.simulated, now.hand)

    def later_kernels(self) -> list[Callable[[], Any]]:
        """Returns functions that compile kernels which the first images do not need."""
        found = [self.whitewater.compile] if self.whitewater else []
        return [*found, *self.picture.later_kernels(), self._draw_next_view]

    def _draw_next_view(self) -> None:
        """Draws the next view, also with a picked particle; the next image is drawn over it."""
        views, wanted = self.views, self.state.wanted
        self.views = Views(self.state, self.scene)
        self.views.next()
        try:
            for index in (None, 0):
                self.views.neighbourhood.pick(index)
                self.state.wanted = self.views.wanted
                self.draw()
        finally:
            self.views, self.state.wanted = views, wanted

    def draw_as_with_bodies(self) -> None:
        """Compiles the kernels for bodies, which a tool may add, by drawing water without bodies
        with these kernels; the next image is drawn over this one."""
        if self.prepared or self.state.boundary.count:
            return
        views, self.views = self.views, Views(self.state, self.scene)
        self.views.name = "water"
        spray = self.surface.thin.spray
        kept = spray.frame, spray.elapsed
        try:
            self.surface.has_bodies = True
            self.picture.take_bodies(True)
            self.draw()
            self.prepared = True
        finally:
            self.surface.has_bodies = False
            self.picture.take_bodies(False)
            self.views, self.shown, self.unfinished = views, None, True
            spray.frame, spray.elapsed = kept

    def reset(self) -> None:
        """Removes spray, whitewater, ripples and wetness; the camera stays."""
        if self.surface:
            self.surface.reset()
        if self.whitewater:
            self.whitewater.reset()
        if self.picture:
            self.picture.reset()

    @property
    def view(self) -> Camera:
        """The camera in axes that move with the box's centre."""
        camera = copy(self.camera)
        camera.target = camera.target - self.state.now.shift
        return camera

    def draw(self, new: bool = True) -> None:
        """Extracts the surface of a `new` state and renders the image, as far as they are used."""
        if self.surface and self.shown_bodies != self.state.boundary.count:
            self._load_surface()
            if self.picture:
                self.picture.take_bodies(self.state.boundary.count > 0)
        water = self.picture is not None and self.views.name == "water"
        moment = self._moment() if water and not self.meshes else None
        if moment and moment == self.shown:
            self.picture.ball = self.state.now.ball
            if self.picture.repeat(self.view, self.state.now.tilt):
                return
        self.shown = moment
        if self.surface and (new or self.unfinished) and (water or self.meshes):
            with self.stage("surface"), self.state.at_frame():
                self.surface.extract(for_image=self.sprayed)
                self.unfinished = False
        if self.picture:
            self._render()

    def _moment(self) -> tuple[Any, ...]:
        """Returns what identifies the water and bodies of an image."""
        now, state = self.state.now, self.state
        # The speed tells a checkpoint of other water at the same time.
        counts = state.particles.count, state.boundary.count
        return now.time, now.resets, now.top_speed, now.spilt, *counts

    def matted_image(self) -> np.ndarray:
        """Renders the last image again, (height, width, 4) uint8, with its opacity."""
        shown, look = [], self.picture.look
        for level in (0.0, 1.0):
            plain = {"background": (level,) * 3, "background_top": None}
            self.picture.change(look.model_copy(update=plain))
            self._render()
            shown.append(self.picture.to_numpy_u8())
        self.picture.change(look)
        return matted(*shown)

    def _render(self) -> None:
        """Renders the surface, or the particles."""
        now = self.state.now
        self.picture.ball = now.ball
        with self.stage("picture"), self.state.at_frame():
            if self.views.name == "water":
                self.picture.draw_water(self.view, now.tilt, self.sprayed)
                return
            self.views.neighbourhood.follow()
            if self.views.cut is not None:
                self.views.cut = self._near()
            value, lo, hi = self.views.values()
            self.picture.draw_particles(
                self.view,
                now.tilt,
                self.state.particles.x,
                value,
                lo,
                hi,
                self.state.particles.count,
                self.views.radius,
                legend=self.views.legend(lo, hi),
            )

    def pick(self, i: int, j: int) -> np.ndarray | None:
        """Returns the point of the water or of a floating body [m], box frame, at a pixel (i right,
        j up), or None."""
        if self.views.name == "water":
            water, (eye, direction) = self.picture.pick(i, j), self.ray(i, j)
            body = floating_at(self.state.boundary, eye, direction)
            hits = [x for x in (water, body[1] if body else None) if x is not None]
            return min(hits, key=lambda x: float((x - eye) @ direction), default=None)
        found = self.particle_at(i, j)
        return None if found is None else found[1]

    def ray(self, i: float, j: float) -> tuple[np.ndarray, np.ndarray]:
        """Returns origin [m] and direction of a pixel's ray in the box frame."""
        width, height = self.picture.size
        return self.view.box_ray(i, j, width, height, self.state.plan.size, self.state.now.tilt)

    def particle_at(self, i: int, j: int) -> tuple[int, np.ndarray] | None:
        """Returns the nearest visible particle at a pixel (i right, j up), as its index and the
        point of the ray closest to its centre [m]; None if there is no particle."""
        eye, direction = self.ray(i, j)
        x = self.state.particles.numpy("x") - eye
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
        return self.state.now.tilt.T @ (back / np.linalg.norm(back))

    def extracted(self) -> SurfaceMesh:
        """Extracts and returns the surface, spray included."""
        self.surface = self.surface or self._load_surface()
        with self.state.at_frame():
            self.surface.extract()
        return self.surface.mesh
