"""Simulations side by side in one image: what every audience is given, of one or of several."""

import gc
from copy import copy
from dataclasses import replace
from typing import Any

import numpy as np
import taichi as ti

from msph.picture.camera import Camera
from msph.picture.overlay import Overlay
from msph.picture.pixels import Image, as_u8
from msph.scene.live import live_parameters
from msph.stage import pages
from msph.stage.controls import Controls
from msph.stage.show import Show
from msph.taichi_internals import data_oriented, kernel

# Pixels between two pictures, and their colour.
GAP, GROUND = 2, (0.04, 0.08, 0.12)
# Room of the text on each and its distance from the top, under the line that tells the time, in
# text heights; frames between two readings of what it says.
ROOM, TOP, EVERY = 5.0, 2.6, 20
# Frames whose times are kept of each, for their median.
KEPT = 60


def width_of_each(number: int, width: int) -> int:
    """Width of each of `number` pictures in a row of `width` pixels."""
    return (width - GAP * (number - 1)) // number


@data_oriented
class Row:
    """Simulations side by side in one image: the first, `lead`, is steered.

    shows: one or several, each with an image of width_of_each() pixels or none. labels: a name of
    each, shown with its speed and error; "" for none. size (width, height) [pixels] of the common
    image, over `below` pixels that are left free; None where one image, or none, is all there is.
    """

    def __init__(
        self,
        shows: list[Show],
        labels: list[str] | None = None,
        size: tuple[int, int] | None = None,
        below: int = 0,
    ):
        self.shows, self.labels, self.below = shows, labels or [""] * len(shows), below
        self.told = 0
        # Of each the live keys of its scene as given: a viscosity moved to 0 stays one.
        self.live = [{live.key for live in live_parameters(show.scene)} for show in shows]
        # Of each the distance at which its whole box is seen [m].
        self.homes = [show.camera.distance if show.picture else 1.0 for show in shows]
        self.common: Image | None = None
        if size:
            self._compose(size)
        elif self.lead.picture:
            self.size = self.lead.picture.size

    def _compose(self, size: tuple[int, int]) -> None:
        """The common image, and room for words on it."""
        self.size, self.common = size, Image(ti.Vector.field(3, ti.f32, size), *size)
        self.text = pages.text_height(size[1])
        room = self.lead.picture.width, round(ROOM * self.text)
        self.names = [f"simulation {k}" for k in range(len(self.shows))]
        self.overlay = Overlay(*size, dict.fromkeys(self.names, room))

    @property
    def image(self) -> Image:
        """What is seen of all."""
        return self.common or self.lead.picture.image

    @property
    def composed(self) -> bool:
        """Whether the image is put together from several, or has pixels left free."""
        return self.common is not None

    @property
    def lead(self) -> Show:
        """The simulation that is steered."""
        return self.shows[0]

    @property
    def picture(self) -> Any:
        """What is seen of all, if anything is."""
        return self if self.lead.picture else None

    def close(self) -> None:
        """Gives back the memory of all simulations; nothing can be done with them afterwards."""
        for show in self.shows:
            show.close()
        # Objects with kernels refer to themselves.
        gc.collect()

    def frame(self, controls: Controls) -> None:
        """A frame of each; the others simulate what the first has. Controls are in the first's
        frame: boxes of other sizes are pushed at the same place in metres."""
        lead = self.lead
        lead.frame(controls)
        # Where a body stops a frame is given up, of all.
        waits = controls.paused or lead.simulated == 0.0
        same = replace(controls, frame_time=lead.simulated or None, budget=None, paused=waits)
        for show, home in zip(self.shows[1:], self.homes[1:], strict=True):
            if self.picture:
                self._match_view(show, home)
            show.frame(replace(same, next_view=False))
        self.draw_together()

    def _match_view(self, show: Show, home: float) -> None:
        """Shows of another what is shown of the first."""
        lead = self.lead
        show.camera = self._matching_camera(show, home)
        show.views.cut = None if lead.views.cut is None else show.views.cut
        show.views.name = lead.views.name if lead.views.name in show.views.names else "water"

    def _matching_camera(self, show: Show, home: float) -> Camera:
        """The first one's point of view, at this one's distance."""
        lead, camera = self.lead.camera, copy(self.lead.camera)
        scale = home / self.homes[0]
        camera.home = np.array(show.simulation.size) / 2
        camera.target = camera.home + scale * (lead.target - lead.home)
        camera.distance = scale * lead.distance
        return camera

    def draw_together(self) -> None:
        """Puts the images side by side, with what is known of each over it."""
        if not self.common:
            return
        self.common.field.fill(GROUND)
        for k, show in enumerate(self.shows):
            picture, left = show.picture, k * (show.picture.width + GAP)
            self._put(left, self.below, *picture.size, picture.image.field)
        if any(self.labels):
            if self.told % EVERY == 0:
                for k, show in enumerate(self.shows):
                    self._put_label(k, show)
            self.told += 1
            self.overlay.draw(self.image)

    def _put_label(self, k: int, show: Show) -> None:
        """Name, speed and error of one, over it."""
        texts = [(self.labels[k], pages.INK), *((t, pages.FAINT) for t in speed_and_error(show))]
        page = pages.lines(texts, self.text)
        left = k * (show.picture.width + GAP)
        self.overlay.put(self.names[k], page, left, round(TOP * self.text))

    @kernel
    def _put(self, left: ti.i32, low: ti.i32, width: ti.i32, height: ti.i32, field: ti.template()):
        for i, j in ti.ndrange(width, height):
            self.common.field[left + i, low + j] = field[i, j]  # type: ignore[union-attr]

    def show_under(self, cursor: np.ndarray) -> tuple[Show, np.ndarray]:
        """The show under a cursor (right, up, in shares of the window), and the cursor in shares of
        its picture."""
        pitch = self.lead.picture.width + GAP
        place = cursor * self.size
        k = int(np.clip(place[0] // pitch, 0, len(self.shows) - 1))
        return self.shows[k], self.to_picture(self.shows[k], cursor)

    def to_picture(self, show: Show, cursor: np.ndarray) -> np.ndarray:
        """The cursor in shares of a show's picture, beyond its edges, too."""
        left = self.shows.index(show) * (show.picture.width + GAP)
        pixels = cursor * self.size - (left, self.below)
        return pixels / (show.picture.width, show.picture.height)

    def to_window(self, show: Show, shares: np.ndarray) -> np.ndarray:
        """Places (n, 2) in shares of a show's picture, in shares of the window."""
        left = self.shows.index(show) * (show.picture.width + GAP)
        pixels = shares * (show.picture.width, show.picture.height) + (left, self.below)
        return pixels / self.size

    # What an audience does to a show, done to all.

    def set(self, key: str, value: float) -> None:
        for show, live in zip(self.shows, self.live, strict=True):
            if key in live:
                show.set(key, value)

    def slice(self) -> None:
        for show in self.shows:
            show.slice()

    def reset(self) -> None:
        for show in self.shows:
            show.reset()

    def draw(self) -> None:
        for show in self.shows:
            show.draw()
        self.draw_together()

    def moment(self) -> dict[str, Any]:
        """What is seen now; "state" holds the arrays."""
        moments = [show.moment() for show in self.shows]
        states = {f"{k} {name}": a for k, m in enumerate(moments) for name, a in m["state"].items()}
        return {"state": states, "moments": moments}

    def show_moment(self, moment: dict[str, Any]) -> None:
        for show, its in zip(self.shows, moment["moments"], strict=True):
            show.show_moment(its)
        self.draw_together()

    @property
    def scale(self) -> float:
        return self.lead.picture.scale

    @scale.setter
    def scale(self, scale: float) -> None:
        for show in self.shows:
            show.picture.scale = scale

    def to_numpy_u8(self) -> np.ndarray:
        """(height, width, 3) uint8, first row at the top, without what is left free."""
        return as_u8(self.image)[: self.size[1] - self.below]

    def warnings(self) -> list[str]:
        return [warning for show in self.shows for warning in show.warnings()]


def show_with_picked(row: Row) -> Show | None:
    """The one whose particle was picked and is seen, if any."""
    seen = (s for s in row.shows if s.views.name != "water")
    return next((s for s in seen if s.views.neighbourhood.id is not None), None)


def speed_and_error(show: Show) -> list[str]:
    """What a frame's water takes, how many particles, and the density error, in words."""
    frames = show.timings.frames if show.timings else []
    fluid = [frame["fluid"] for frame in frames if "fluid" in frame]
    told = [f"{sum(show.simulation.counts()):,} particles"]
    if fluid:
        told.append(f"{1e3 * float(np.median(fluid)):.1f} ms")
    error = show.ledger.last_density_error() if show.ledger.entries else np.nan
    second = f"density off by {100.0 * error:.2f} %" if np.isfinite(error) else ""
    return [", ".join(told), *([second] if second else [])]
