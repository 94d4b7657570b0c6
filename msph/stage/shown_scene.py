"""What a window reads of a simulation, which runs in this process or in another one."""

import math
from collections.abc import Callable
from typing import Any

from msph.launches import run_in_steps
from msph.measure.bulk import bulk_density
from msph.measure.snapshot import Snapshot
from msph.measure.timings import Timings
from msph.scene.live import live_parameters, read, with_live_value
from msph.scene.parts import value_of, with_value
from msph.scene.schema import Scene
from msph.state import Moment, State
from msph.surface import SurfaceMesh

# Number of frames whose times are kept, for the median on a label.
KEPT_FRAMES = 60


class ShownScene:
    """Scene whose live parameters the user changes, with its display.

    scene: with the present live parameters; initial: without changes; live: keys of the live
    parameters, of which a viscosity set to 0 remains one. now: numbers of the last frame; state:
    what is drawn, by `display`. note: message to the user about the last frame. interactive: see
    Show; parallel: True for a simulation of another process, which runs while images are drawn;
    new: the last frame drew a new state; fresh: a new state has not been drawn.
    """

    interactive: bool
    state: State
    display: Any
    now: Moment
    parallel, fresh, new = False, True, True
    # Called after each step in this process with the completed share (0 to 1) of its frame.
    on_progress: Callable[[float], None] | None = None

    def __init__(self, scene: Scene, timings: Timings | None = None):
        self.scene = self.initial = scene
        self.timings = timings or Timings(keep=KEPT_FRAMES)
        self.live = {live.key for live in live_parameters(scene)}
        self.later: list[Callable[[], Any]] = []  # compile kernels in later frames
        self.note = ""

    def compile_later(self) -> None:
        """Compiles a part of a kernel that the first frames do not need, in a frame that is drawn
        afterwards."""
        if self.later and run_in_steps(self.later[0]):
            self.later.pop(0)

    @property
    def draws(self) -> bool:
        """True if frames have an image or a mesh."""
        return True

    def volume(self) -> float:
        """Returns the volume enclosed by the surface mesh [m^3]; NaN if the mesh overflowed."""
        mesh = self.extracted()
        return math.nan if mesh.overflowed() else mesh.volume()

    def extracted(self) -> SurfaceMesh:
        """Extracts and returns the present surface, spray included."""
        return self.display.extracted()

    def water(self) -> Snapshot:
        """Returns the present water, without that in pipes of openings, which has no surface."""
        raise NotImplementedError

    def water_volume(self) -> float:
        """Returns the volume of the water at rest density [m^3]."""
        return self.water().volume

    def bulk_density_error(self) -> float:
        """Returns the error of the bulk density (-), measured from the positions in milliseconds;
        NaN if the water is too thin."""
        water = self.water()
        return bulk_density(water.x, water.spacing, water.size, water.free).mean - 1.0

    def volume_error(self) -> float:
        """Returns the surface's volume over the volume at rest density, minus 1 (-)."""
        return self.volume() / self.water_volume() - 1.0

    def warnings(self) -> list[str]:
        """Returns warnings about a truncated mesh, waiting inflows and stopped bodies."""
        surface = self.display.surface if self.draws else None
        overflow = surface.mesh.overflowed() if surface else None
        told = [text for text in (overflow, self.now.waiting) if text]
        stopped = sorted(self.now.stopped)
        return [*told, *(f"{name} stopped: it had trapped water" for name in stopped)]

    def set(self, key: str, value: float | None) -> None:
        """Sets a live parameter (msph/scene/live.py), None for its initial value; parameters that
        this scene does not have are ignored."""
        if key not in self.live:
            return
        if value is None:
            self.scene = with_value(self.scene, key, value_of(self.initial, key))
        else:
            self.scene = with_live_value(self.scene, key, value)
        self._changed(key)

    def _changed(self, key: str) -> None:
        """Applies the present value of a live parameter."""

    def changes(self) -> dict[str, float]:
        """Returns the live parameters that differ from their initial values."""
        values = {key: (read(self.scene, key), read(self.initial, key)) for key in self.live}
        return {key: now for key, (now, before) in values.items() if now != before}
