"""Automatic quality: measures which quality runs in real time on this machine."""

import contextlib
import hashlib
import time

import taichi as ti

from msph import user_cache
from msph.device import start
from msph.gpu_name import gpu_name
from msph.measure.machine import machine
from msph.options import AS_GIVEN, QUALITIES
from msph.scene.errors import SceneError
from msph.scene.quality import at_quality, single_quality_reason
from msph.scene.schema import Scene
from msph.stage.controls import Controls
from msph.stage.ggui_window import Window
from msph.stage.link import Order
from msph.stage.pacer import PLANNED, RATES, SCALES
from msph.stage.preparation import named, prepare_row, say
from msph.stage.remote import Remote

# Wall-clock time of a trial [s], number of frames before it (compilation), and image size without a
# window [pixels].
SECONDS, UNTIMED, SIZE = 0.5, 3, (960, 540)
# Tilt of the pool during a trial [rad]: moving water takes up to a third more time than water at
# rest, and the water of some scenes moves late (`rolled`) or only if the user moves it.
TILT = (0.2, 0.0)


def finest_in_real_time(
    scene: Scene, name: str, window: Window | None = None, remote: Remote | None = None
) -> str:
    """Returns the finest quality that runs in real time, the coarsest possible one if none does,
    and AS_GIVEN for a single quality. The simulations run for the window, which shows the progress,
    in another process, without both in this one. The result is remembered for later starts on this
    machine.

    Coarse qualities are tried first: on a slow machine a fine one takes long to build, and its
    loops over many particles would be compiled without use."""
    if single_quality_reason(scene):
        return AS_GIVEN
    key = _key(scene, window)
    known = user_cache.recall(key, str)
    with contextlib.suppress(SceneError, KeyError):
        if known:
            at_quality(scene, known, name)
            say(f"{name}: quality {known}, as measured earlier")
            return known
    best = ""
    for quality in QUALITIES:
        try:
            tried = at_quality(scene, quality, name)
        except SceneError:
            continue  # its particles do not fit the box or the bodies
        factor = real_time_factor(tried, quality, window, remote)
        say(f"{name}: quality {quality} runs at {factor:.1f} times real time")
        fits = factor * PLANNED >= 1.0
        if fits or not best:
            best = quality
        if not fits:
            break
    user_cache.remember(key, best)
    return best


def forget(scene: Scene, window: Window) -> None:
    """Forgets the quality that was found for a scene in a window."""
    user_cache.forget(_key(scene, window))


def _key(scene: Scene, window: Window | None) -> str:
    """Returns the key of a scene's quality: all on which it depends but the program's version."""
    arch, (width, height) = start(), window.size if window else SIZE
    threads = f"{ti.cfg.cpu_max_num_threads} threads, {gpu_name(arch) if arch != 'cpu' else arch}"
    digest = hashlib.sha256(scene.model_dump_json().encode()).hexdigest()
    return f"quality of scene {digest} at {width}x{height} on {machine()}, {threads}"


def real_time_factor(
    scene: Scene, quality: str, window: Window | None, remote: Remote | None
) -> float:
    """Returns the real-time factor over the scene's play.speed (-), at the lowest frame rate and
    image scale of `play`, in a tilted pool."""
    fps, doing = scene.play.fps, f"trying quality {quality}"
    controls = Controls(
        budget=SECONDS,
        scale=SCALES[-1],
        frame_time=scene.play.speed / (RATES[-1] * fps),
        tilt=TILT,
    )
    order = Order([scene], whole=True)
    if window and remote:
        row = remote.row(order, window.size, named(window.report, doing))
    else:
        row = prepare_row(order, SIZE)
    for _ in range(UNTIMED):
        row.frame(controls)
        row.receive(SECONDS)
    simulated = 0.0
    begin, wall = time.perf_counter(), 0.0
    while wall < SECONDS:
        row.frame(controls)
        row.receive(SECONDS)
        simulated += row.lead.simulated if row.lead.fresh else 0.0
        if window:
            window.report(doing)
            window.again()
        wall = time.perf_counter() - begin
    row.close()
    return simulated / (scene.play.speed * wall)
