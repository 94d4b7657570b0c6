"""Automatic quality: measures which quality runs in real time on this machine."""

import math
import time
from dataclasses import dataclass

from msph.measure.timings import Timings
from msph.options import AS_GIVEN, QUALITIES
from msph.scene.errors import SceneError
from msph.scene.quality import at_quality, single_quality_reason
from msph.scene.schema import Scene
from msph.stage.controls import Controls
from msph.stage.pacer import PLANNED, RATES, SCALES
from msph.stage.preparation import compiling, say
from msph.stage.row import Row
from msph.stage.show import INTERACTIVE, Show
from msph.stage.window import Window

# Wall-clock time of a trial [s], number of frames before it (compilation), and image size without a
# window [pixels].
SECONDS, UNTIMED, SIZE = 0.5, 3, (960, 540)


@dataclass(frozen=True)
class Trial:
    """Elapsed time over simulated time at play.speed (-): in all, and of the water."""

    whole: float
    water: float

    @property
    def fits(self) -> bool:
        """True if the scene runs in real time, with a reserve."""
        return self.whole <= PLANNED

    @property
    def finer_may_fit(self) -> bool:
        """True if the next quality may run in real time: particles of half the volume at least
        double the time of the water."""
        return self.whole + self.water <= PLANNED


def finest_in_real_time(scene: Scene, name: str, window: Window | None = None) -> str:
    """Returns the finest quality that runs in real time, the coarsest if none does, and AS_GIVEN
    for a single quality. The window, if any, shows the progress.

    Coarse qualities come first: on a slow machine a fine one takes long to build, and its loops of
    many particles would be compiled in vain."""
    if single_quality_reason(scene):
        return AS_GIVEN
    best = ""
    for quality in QUALITIES:
        try:
            tried = at_quality(scene, quality, name)
        except SceneError:
            continue  # its particles do not fit the box or the bodies
        found = trial(tried, quality, window)
        say(f"{name}: quality {quality} runs at {1.0 / found.whole:.1f} times real time")
        if found.fits or not best:
            best = quality
        if not (found.fits and found.finer_may_fit):
            break
    return best


def trial(scene: Scene, quality: str, window: Window | None = None) -> Trial:
    """Runs a scene for SECONDS at the lowest frame rate and image scale of `play`."""
    frame_time, size = scene.play.speed / (RATES[-1] * scene.play.fps), SIZE
    controls = Controls(budget=SECONDS, scale=SCALES[-1])
    timings = Timings()
    if window:
        size = window.size
        window.report(f"trying quality {quality}")
    with compiling(window.report if window else None, f"trying quality {quality}: "):
        row = Row([Show(scene, frame_time, size, timings=timings, **INTERACTIVE)])
        row.lead.warm_up()
        for _ in range(UNTIMED):
            row.frame(controls)
    timings.discard()
    simulated = 0.0
    begin, wall = time.perf_counter(), 0.0
    while wall < SECONDS:
        row.frame(controls)
        simulated += row.lead.simulated
        if window:
            window.report(f"trying quality {quality}")
            window.again()
        wall = time.perf_counter() - begin
    row.close()
    per_second = scene.play.speed / simulated if simulated else math.inf
    return Trial(wall * per_second, timings.total("fluid") * per_second)
