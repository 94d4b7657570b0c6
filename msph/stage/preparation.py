"""From a scene to a row of simulations that are ready for their first frame."""

import contextlib
import sys
import time
from collections.abc import Callable, Iterator

from tqdm import tqdm

from msph.measure.summary import water_laid
from msph.measure.timings import Timings
from msph.scene.check import cautions
from msph.scene.effort import effort
from msph.scene.schema import Scene
from msph.stage.row import KEPT, Row, width_of_each
from msph.stage.show import INTERACTIVE, Show
from msph.taichi_internals import watch_compiling

# Called with what is being done, in words, before each kernel that is compiled.
Tell = Callable[[str], None]


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
    """Builds a show, with the options it has, and compiles its kernels."""
    begin = time.perf_counter()
    for caution in (*cautions(scene), *effort(scene)):
        say(f"warning: {caution}")
    with compiling(tell):
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
) -> Row:
    """A row of simulations to be played with in an image of size (width, height) [pixels], over
    `below` pixels that are left free, with their labels."""
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
            **INTERACTIVE,
        )
        for scene in scenes
    ]
    return Row(shows) if alone else Row(shows, labels, size, below)


def laid_and_asked(water: dict[str, float]) -> str:
    """Mass of the water in words, and what the scene asked for where four digits differ."""
    laid, asked = (f"{water[key]:.4g} kg" for key in ("mass_laid_kg", "mass_asked_kg"))
    return laid if laid == asked else f"{laid} of {asked} asked"


@contextlib.contextmanager
def compiling(tell: Tell | None) -> Iterator[None]:
    """Tells of each kernel that is compiled within, and of the elapsed time; without `tell` a
    terminal shows it."""
    since = time.perf_counter()
    # With disable=None the line appears on terminals only.
    line = tqdm(
        bar_format="compiling {postfix} ({elapsed})",
        disable=True if tell else None,
        leave=False,
        file=sys.stderr,
    )

    def next_kernel(name: str) -> None:
        line.set_postfix_str(name)
        if tell:
            tell(f"compiling {name}, {time.perf_counter() - since:.1f} s")

    with line, watch_compiling(next_kernel):
        yield
