"""From a scene to a show that is ready for its first frame, telling how far it is."""

import sys
import time
from collections.abc import Callable

from tqdm import tqdm

from msph import user_cache
from msph.measure.summary import water_laid
from msph.scene.check import cautions
from msph.scene.schema import Scene
from msph.stage.show import Show
from msph.taichi_internals import watch_compiling

# Kernels of a scene that has not been started before: those of the default one.
TYPICAL_KERNELS = 65
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
    for caution in cautions(scene):
        say(f"warning: {caution}")
    with Kernels(scene, size is not None, tell):
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


def laid_and_asked(water: dict[str, float]) -> str:
    """Mass of the water in words, and what the scene asked for where four digits differ."""
    laid, asked = (f"{water[key]:.4g} kg" for key in ("mass_laid_kg", "mass_asked_kg"))
    return laid if laid == asked else f"{laid} of {asked} asked"


class Kernels:
    """Counts the kernels compiled while it is entered; their number is known from the last time
    that a scene with the same terms was started."""

    def __init__(self, scene: Scene, picture: bool, tell: Tell | None):
        self.tell, self.count = tell, 0
        p = scene.projection
        terms = {
            "adaptation": scene.adaptation.enabled,
            "bodies": bool(scene.obstacles or scene.container),
            "viscosity": p.viscosity > 0.0,
            "tension": p.tension > 0.0,
            "picture": picture,
        }
        self.key = " ".join(["kernels", scene.method, *(name for name, on in terms.items() if on)])
        self.expected = int(user_cache.recall(self.key, TYPICAL_KERNELS))

    def __enter__(self) -> "Kernels":
        self.watch = watch_compiling(self._next)
        self.watch.__enter__()
        # With disable=None the bar appears on terminals only.
        self.bar = tqdm(
            total=self.expected,
            desc="compiling kernels",
            unit="kernel",
            disable=True if self.tell else None,
            leave=False,
            file=sys.stderr,
            dynamic_ncols=True,
        )
        return self

    def _next(self, name: str) -> None:
        self.count += 1
        self.bar.update()
        if self.tell:
            share = min(self.count / self.expected, 1.0)
            self.tell(share, f"compiling {name} ({self.count} of {self.expected})")

    def __exit__(self, kind, error, trace) -> None:
        self.bar.close()
        self.watch.__exit__(kind, error, trace)
        if kind is None and self.count:
            user_cache.remember(self.key, self.count)
