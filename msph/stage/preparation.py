"""From a scene to a show that is ready for its first frame, telling how far it is."""

import contextlib
import sys
import time
from collections.abc import Callable

from tqdm import tqdm

from msph import user_cache
from msph.measure.summary import water_laid
from msph.measure.timings import Timings
from msph.scene.check import cautions
from msph.scene.effort import effort
from msph.scene.schema import Scene
from msph.stage.row import KEPT, Row, Waters, width_of_each
from msph.stage.show import PLAYED, Show
from msph.taichi_internals import watch_compiling

# Kernels of a scene whose terms have not been started before: those of the default one.
TYPICAL_KERNELS = 41
# How far preparation is: a share (0 to 1), and what is being compiled.
Tell = Callable[[float, str], None]


def say(text: str) -> None:
    """A line on the error stream, on its own even while a progress bar is shown."""
    tqdm.write(text, file=sys.stderr)


def prepare(
    scene: Scene,
    frame_time: float,
    size: tuple[int, int] | None = None,
    tell: Tell | None = None,
    **options,
) -> Show:
    """Builds a show, with the options it has, and compiles its kernels.

    tell: called before each kernel; without it a bar is shown where there is a terminal.
    """
    begin = time.perf_counter()
    for caution in (*cautions(scene), *effort(scene)):
        say(f"warning: {caution}")
    with counting(scene, size is not None, tell):
        show = Show(scene, frame_time, size, **options)
        show.warm_up()
    ready = f"ready in {time.perf_counter() - begin:.1f} s, {sum(show.counts):,} particles, "
    ready += laid_and_asked(water_laid(scene, show.simulation, show.counts))
    if show.simulation.left_out:
        ready += (
            f"; {show.simulation.left_out:,} inside obstacles or outside the container left out"
        )
    say(ready)
    return show


def prepare_row(
    scenes: list[Scene],
    labels: list[str],
    size: tuple[int, int] | None,
    tell: Tell | None = None,
    below: int = 0,
) -> Waters:
    """A show to be played with in pictures of size (width, height) [pixels]; of several scenes, or
    over `below` pixels that are left free, a row of shows, with their labels."""
    alone = len(scenes) == 1 and not below
    each = size
    if size and not alone:
        each = width_of_each(len(scenes), size[0]), size[1] - below
    shows = [
        prepare(
            scene,
            1.0 / scene.play.fps,
            each,
            tell=tell,
            timings=Timings(keep=1 if alone else KEPT),
            **PLAYED,
        )
        for scene in scenes
    ]
    return shows[0] if alone else Row(shows, labels, size, below)


def laid_and_asked(water: dict[str, float]) -> str:
    """Mass of the water in words, and what the scene asked for where four digits differ."""
    laid, asked = (f"{water[key]:.4g} kg" for key in ("mass_laid_kg", "mass_asked_kg"))
    return laid if laid == asked else f"{laid} of {asked} asked"


@contextlib.contextmanager
def counting(scene: Scene, picture: bool, tell: Tell | None):
    """Counts the kernels compiled within, and tells or shows how far it is. Their number is known
    from the last time that a scene with the same terms was started."""
    p = scene.projection
    terms = {
        "adaptation": scene.adaptation.enabled,
        "bodies": bool(scene.obstacles or scene.container),
        "viscosity": p.viscosity > 0.0,
        "tension": p.tension > 0.0,
        "picture": picture,
    }
    key = " ".join(["kernels", scene.method, *(name for name, on in terms.items() if on)])
    expected, count = int(user_cache.recall(key, TYPICAL_KERNELS)), 0
    # With disable=None the bar appears on terminals only.
    bar = tqdm(
        total=expected,
        desc="compiling kernels",
        unit="kernel",
        disable=True if tell else None,
        leave=False,
        file=sys.stderr,
        dynamic_ncols=True,
    )

    def next_kernel(name: str) -> None:
        nonlocal count, expected
        count += 1
        expected = max(expected, count)
        bar.update()
        if tell:
            tell(min(count / expected, 1.0), f"compiling {name} ({count} of {expected})")

    with bar, watch_compiling(next_kernel):
        yield
    if count:
        user_cache.remember(key, count)
