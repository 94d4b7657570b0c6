"""Row: one or several simulations side by side in one image, as the frame loop runs them."""

import gc
import time
from collections.abc import Callable
from copy import copy
from dataclasses import replace
from typing import Any

import numpy as np
import taichi as ti

from msph.errors import BlowUpError
from msph.launches import data_oriented, kernel
from msph.picture.camera import Camera
from msph.picture.overlay import Overlay
from msph.picture.pixels import Image, as_u8
from msph.stage.controls import Controls
from msph.stage.pages import lines
from msph.stage.sheet import FAINT, INK, text_height

# Gap between two images [pixels], and its colour.
GAP, GROUND = 2, (0.04, 0.08, 0.12)
# Largest height of a label [text heights], and frames between two updates of a label.
LABEL_HEIGHT, EVERY = 4.6, 40
# Time [s] for which a window waits for its simulations before it shows the last image again.
PATIENCE = 0.05
# Time [s] from which a wait for the simulations is shown.
LATE = 0.3


def width_of_each(number: int, width: int) -> int:
    """Returns the width of each of `number` images in a row of `width` pixels."""
    return (width - GAP * (number - 1)) // number


def strip_height(labels: list[str], height: int) -> int:
    """Returns the height of the labels below the images of a row of `height`, both in pixels."""
    return round(LABEL_HEIGHT * text_height(height)) if any(labels) else 0


@data_oriented
class Row:
    """Simulations side by side in one image; the user controls the first, `lead`.

    shows: with images of width_of_each() pixels, or without images. labels: names, displayed below
    the images with speed and error; "" for no label. size (width, height) [pixels] of the common
    image, with `below` free pixels at the lower edge; None for a single show's image, or no image.
    remote: the other process in which the simulations run, None for this one. between: called
    between the images of such simulations, since three take 0.1 s. restart: message where an
    unstable simulation begins again, and with it all others; "" where it raises BlowUpError.
    """

    remote: Any = None
    between: Callable[[], Any] | None = None

    def __init__(
        self,
        shows: list[Any],
        labels: list[str] | None = None,
        size: tuple[int, int] | None = None,
        below: int = 0,
        restart: str = "",
    ):
        self.shows, self.labels, self.below = shows, labels or [""] * len(shows), below
        self.restart = restart
        self.low = 0  # lower edge of the images [pixels]
        self.updates = 0
        # Initial camera distance of each show [m], at which the whole box is visible.
        self.homes = [show.display.camera.distance if show.size else 1.0 for show in shows]
        self.common: Image | None = None
        if size:
            self._compose(size)
        elif self.lead.size:
            self.size = self.lead.size

    @classmethod
    def arranged(
        cls,
        build: Callable[[int, tuple[int, int] | None], Any],
        labels: list[str],
        size: tuple[int, int] | None,
        below: int = 0,
        restart: str = "",
    ) -> "Row":
        """Builds a show for each label, by its number and the size of its image, with the labels
        below the images. A single show without free pixels below needs no common image."""
        each = size
        common = size if below or len(labels) > 1 else None
        if common:
            width, height = common
            each = width_of_each(len(labels), width), height - below - strip_height(labels, height)
        shows = [build(k, each) for k in range(len(labels))]
        return cls(shows, labels, common, below, restart)

    def _compose(self, size: tuple[int, int]) -> None:
        """Allocates the common image and its labels."""
        self.size, self.common = size, Image(ti.Vector.field(3, ti.f32, size), *size)
        self.text, strip = text_height(size[1]), strip_height(self.labels, size[1])
        self.low = self.below + strip
        room = self.lead.display.picture.width, strip
        self.names = [f"simulation {k}" for k in range(len(self.shows))]
        self.overlay = Overlay(*size, dict.fromkeys(self.names, room))

    @property
    def image(self) -> Image:
        """The common image."""
        return self.common or self.lead.display.picture.image

    @property
    def composed(self) -> bool:
        """True if the image is composed of several images, or has free pixels below."""
        return self.common is not None

    @property
    def lead(self) -> Any:
        """The show that the user controls."""
        return self.shows[0]

    @property
    def busy(self) -> bool:
        """True while simulations in another process have not answered the last input: further
        input for them waits."""
        return self.remote is not None and self.remote.busy

    @property
    def ended(self) -> bool:
        """True if all frames that were ordered of another process have been drawn."""
        return self.remote is not None and not (self.remote.left or self.busy or self.lead.fresh)

    @property
    def waiting(self) -> str:
        """Message about a long wait for simulations in another process, "" without one."""
        if not self.busy or (waited := time.perf_counter() - self.remote.since) < LATE:
            return ""
        doing = self.remote.doing
        return f"waiting for the simulation, {doing and f'{doing}, '}{waited:.1f} s"

    def receive(self, patience: float = PATIENCE) -> None:
        """Waits at most `patience` [s] for simulations in another process."""
        if self.remote:
            self.remote.receive(patience)

    def close(self) -> None:
        """Frees the memory of all simulations, which cannot be used afterwards."""
        if self.remote:
            self.remote.end()
        for show in self.shows:
            show.close()
        # Objects with kernels are in reference cycles.
        gc.collect()

    def frame(self, controls: Controls) -> None:
        """Runs a frame of each show; all simulate the time that the lead has simulated, with the
        same input. Only here does input act on simulations, live or replayed."""
        try:
            self._frame(controls)
        except BlowUpError:
            if not self.restart:
                raise
            self.reset()
            self.lead.note = self.restart

    def _frame(self, controls: Controls) -> None:
        lead = self.lead
        if self.remote:
            self.remote.give(controls)
        # A frame compiles one kernel, not one for each show.
        for show in self.shows[1:]:
            lead.later, show.later = lead.later + show.later, []
        lead.frame(controls)
        # If the lead's frame was undone for a stopped body, all shows wait.
        waits = lead.simulated == 0.0
        same = replace(controls, frame_time=lead.simulated or None, until=None, still=waits)
        for show, home in zip(self.shows[1:], self.homes[1:], strict=True):
            if self.remote and self.between:
                self.between()
            if lead.size:
                self._match_view(show, home)
            show.frame(replace(same, budget=None))
        if not controls.hidden:
            self.draw_together()

    def _match_view(self, show: Any, home: float) -> None:
        """Sets the lead's camera, slice and view for another show."""
        show.display.camera = self._matching_camera(show, home)
        lead, views = self.lead.display.views, show.display.views
        views.cut = None if lead.cut is None else views.cut
        views.name = lead.name if lead.name in views.names else "water"

    def _matching_camera(self, show: Any, home: float) -> Camera:
        """Returns the lead's camera, at a distance scaled to the show's box."""
        lead, camera = self.lead.display.camera, copy(self.lead.display.camera)
        scale = home / self.homes[0]
        camera.home = np.array(show.scene.box.size) / 2
        camera.target = camera.home + scale * (lead.target - lead.home)
        camera.distance = scale * lead.distance
        return camera

    def draw_together(self) -> None:
        """Composes the images and their labels."""
        if not self.common:
            return
        self.common.field.fill(GROUND)
        for k, show in enumerate(self.shows):
            picture = show.display.picture
            self._put(self._left(k), self.low, *picture.size, picture.image.field)
        if any(self.labels):
            if self.updates % EVERY == 0:
                for k, show in enumerate(self.shows):
                    self._put_label(k, show)
            self.updates += 1
            self.overlay.draw(self.image)

    def _put_label(self, k: int, show: Any) -> None:
        """Paints the label of a show: name, speed and error."""
        texts = [(self.labels[k], INK), *((t, FAINT) for t in speed_and_error(show))]
        page = lines(texts, self.text).pixels
        self.overlay.put(self.names[k], page, self._left(k), self.size[1] - self.low)

    @kernel
    def _put(self, left: ti.i32, low: ti.i32, width: ti.i32, height: ti.i32, field: ti.template()):
        for i, j in ti.ndrange(width, height):
            self.common.field[left + i, low + j] = field[i, j]  # type: ignore[union-attr]

    def show_under(self, cursor: np.ndarray) -> tuple[Any, np.ndarray]:
        """Returns the show at a cursor (right, up in shares of the window), and the cursor in
        shares of the show's image."""
        k = int(np.clip(cursor[0] * self.size[0] // self._left(1), 0, len(self.shows) - 1))
        return self.shows[k], self.to_picture(self.shows[k], cursor)

    def _left(self, k: int) -> int:
        """Returns the left edge of image k [pixels]."""
        return k * (self.lead.display.picture.width + GAP)

    def to_picture(self, show: Any, cursor: np.ndarray) -> np.ndarray:
        """Converts a cursor from shares of the window to shares of a show's image."""
        corner = self._left(self.shows.index(show)), self.low
        return (cursor * self.size - corner) / show.display.picture.size

    def to_window(self, show: Any, shares: np.ndarray) -> np.ndarray:
        """Converts positions (n, 2) from shares of a show's image to shares of the window."""
        corner = self._left(self.shows.index(show)), self.low
        return (shares * show.display.picture.size + corner) / self.size

    # Applied to all shows.

    def set(self, key: str, value: float | None) -> None:
        for show in self.shows:
            show.set(key, value)

    def reset(self) -> None:
        for show in self.shows:
            show.reset()

    def draw(self) -> None:
        for show in self.shows:
            show.draw()
        self.draw_together()

    def restore(self) -> None:
        """Removes pages from the last image."""
        if self.common:
            self.draw_together()
        else:
            self.draw()

    def to_numpy_u8(self) -> np.ndarray:
        """Returns the image without free pixels, (height, width, 3) uint8, first row at the top."""
        return as_u8(self.image)[: self.size[1] - self.below]


def show_with_picked(row: Row) -> Any:
    """Returns the show with a picked particle in a particle view, if any."""
    visible = (s for s in row.shows if s.display.views.name != "water")
    return next((s for s in visible if s.display.views.neighbourhood.id is not None), None)


def speed_and_error(show: Any) -> list[str]:
    """Returns label lines: number of particles, fluid time per frame, bulk density error."""
    fluid = [frame["fluid"] for frame in show.timings.frames if "fluid" in frame]
    lines = [f"{show.state.particles.count:,} particles"]
    if fluid:
        lines[0] += f", {1e3 * float(np.median(fluid)):.1f} ms"
    error = show.bulk_density_error()
    if np.isfinite(error):
        lines.append(f"bulk density error {100.0 * error:+.2f} %")
    return lines
