"""Automatic quality: measures which quality runs in real time on this machine."""

import time

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


def finest_in_real_time(scene: Scene, name: str, window: Window | None = None) -> str:
    """Returns the finest quality that runs in real time, the coarsest possible one if none does,
    and AS_GIVEN for a single quality. The window, if any, shows the progress.

    Coarse qualities are tried first: on a slow machine a fine one takes long to build, and its
    loops over many particles would be compiled without use."""
    if single_quality_reason(scene):
        return AS_GIVEN
    best = ""
    for quality in QUALITIES:
        try:
            tried = at_quality(scene, quality, name)
        except SceneError:
            continue  # its particles do not fit the box or the bodies
        factor = real_time_factor(tried, quality, window)
        say(f"{name}: quality {quality} runs at {factor:.1f} times real time")
        fits = factor * PLANNED >= 1.0
        if fits or not best:
            best = quality
        if not fits:
            break
    return best


def real_time_factor(scene: Scene, quality: str, window: Window | None = None) -> float:
    """Returns the real-time factor over the scene's play.speed (-), at the lowest frame rate and
    image scale of `play`."""
    frame_time, size = scene.play.speed / (RATES[-1] * scene.play.fps), SIZE
    controls = Controls(budget=SECONDS, scale=SCALES[-1])
    if window:
        size = window.size
        window.report(f"trying quality {quality}")
    with compiling(window.report if window else None, f"trying quality {quality}: "):
        row = Row([Show(scene, frame_time, size, timings=Timings(keep=1), **INTERACTIVE)])
        row.lead.warm_up()
        for _ in range(UNTIMED):
            row.frame(controls)
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
    return simulated / (scene.play.speed * wall)
