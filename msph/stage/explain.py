"""Cost of each optional part of a scene, and the error without it, by measurement."""

import time
from dataclasses import dataclass

import numpy as np
from tabulate import tabulate

from msph.launches import watch_compiling
from msph.measure.resolution import mean_depth
from msph.measure.timings import Timings
from msph.scene.parts import PARTS, Part
from msph.scene.schema import Scene
from msph.stage.benchmark import FRAME_TIME, SIZE, STAGES
from msph.stage.controls import Controls
from msph.stage.link import Order
from msph.stage.preparation import prepare_row
from msph.stage.show import Show

# Simulated time of a run [s], and number of first frames without timing (caches fill).
SECONDS, UNTIMED = 1.0, 3


@dataclass
class Run:
    """A timed simulation. start: time to build it [s]; kernels: number of compiled kernels."""

    show: Show
    start: float
    kernels: int

    @property
    def centres(self) -> np.ndarray:
        """Centre of mass [m] after each frame, (frames, 3)."""
        return np.array([entry.centre for entry in self.show.ledger.entries])

    def milliseconds(self, *stages: str) -> float:
        """Returns the median time of a frame, or of the sum of its stages [ms]."""
        return 1e3 * self.show.timings.percentile(50.0, *stages)


def begin(scene: Scene) -> Run:
    """Builds a scene with rendering."""
    kernels: list[str] = []
    since = time.perf_counter()
    with watch_compiling(kernels.append):
        options = {"timings": Timings()}
        show = prepare_row(Order([scene], options=options, frame_time=FRAME_TIME), SIZE).lead
    return Run(show, time.perf_counter() - since, len(kernels))


def explain(scene: Scene) -> str:
    """Returns a table of the scene and of the scene without each of its parts. The simulations run
    alternately, frame by frame."""
    parts = [part for part in PARTS if part.active(scene)]
    runs = [begin(scene), *(begin(part.without(scene)) for part in parts)]
    for k in range(UNTIMED + round(SECONDS / FRAME_TIME)):
        for run in runs:
            run.show.frame(Controls())
            if k < UNTIMED:
                run.show.timings.discard()
    whole, *others = runs
    depth = mean_depth(scene.gravity, whole.show.simulation.plan, whole.centres[:1])
    heads = ["", "particles", "ms per frame", *STAGES]
    heads += ["saved", "start s", "kernels", "error without it"]
    rows = [[*_costs("full scene", whole, whole), ""]]
    for part, run in zip(parts, others, strict=True):
        error = water_error(whole.centres, run.centres, depth)
        if part.picture:
            error = picture_error(whole.show, run.show)
        rows.append([*_costs(f"without {part.name}", run, whole), error])
    for run in runs:
        run.show.close()
    return "\n".join(
        [
            tabulate(rows, headers=heads, tablefmt="simple", disable_numparse=True),
            "",
            f"{SECONDS:g} s of simulated time, frames of 1/60 s, image {SIZE[0]}x{SIZE[1]}; "
            "times are medians of wall-clock time.",
            saving(parts, others, whole),
        ]
    )


def _costs(name: str, run: Run, whole: Run) -> list[str]:
    frame = run.milliseconds()
    return [
        name,
        f"{sum(run.show.simulation.counts()):,}",
        f"{frame:.1f}",
        *(f"{run.milliseconds(stage):.1f}" for stage in STAGES),
        f"{100.0 * (1.0 - frame / whole.milliseconds()):+.0f} %" if run is not whole else "",
        f"{run.start:.1f}",
        str(run.kernels),
    ]


def water_error(centres: np.ndarray, others: np.ndarray, depth: float) -> str:
    """Describes the largest distance over all frames between two simulations' centres of mass
    (n, 3) [m], relative to the depth [m] if it is positive."""
    away = np.linalg.norm(others - centres, axis=1).max()
    if np.isfinite(depth) and depth > 0.0:
        return f"{100.0 * away / depth:.2f} % of the depth"
    return f"{1e3 * away:.2f} mm"


def picture_error(whole: Show, other: Show) -> str:
    """Describes the mean difference between two shows' images of the first show's particles."""
    other.simulation.restore(whole.simulation.state())
    for show in (whole, other):
        show.draw()
    a, b = (show.display.picture.to_numpy_u8().astype(float) for show in (whole, other))
    return f"{np.abs(a - b).mean():.1f} of 255 a pixel"


def saving(parts: list[Part], others: list[Run], whole: Run) -> str:
    """Describes which part costs most."""
    if not parts:
        return "Nothing to leave out: the scene has no optional part."
    best = min(range(len(others)), key=lambda k: others[k].milliseconds())
    share = 1.0 - others[best].milliseconds() / whole.milliseconds()
    if share <= 0.0:
        return "Nothing is saved by leaving out a part."
    return f"Largest saving: without {parts[best].name}, {100.0 * share:.0f} % of the frame time."
