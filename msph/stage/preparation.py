"""Preparation of scenes: builds simulations and compiles their kernels."""

import contextlib
import sys
import threading
import time
from collections.abc import Callable, Iterator

from tqdm import tqdm

from msph.launches import watch_compiling
from msph.measure.summary import water_mass
from msph.scene.check import cautions
from msph.scene.effort import effort
from msph.stage.link import Order
from msph.stage.row import Row
from msph.stage.show import Show

# The default lock is a semaphore of the system, which a killed process would leave behind.
tqdm.set_lock(threading.RLock())


# Function that displays a progress message; those that follow another closely may be omitted.
Report = Callable[[str], None]


def say(text: str) -> None:
    """Prints a line on stderr, above a progress bar."""
    tqdm.write(text, file=sys.stderr)


def prepare_row(order: Order, size: tuple[int, int] | None = None, below: int = 0) -> Row:
    """Builds the simulations of an order in this process, and describes them; see built_row()."""
    begin = time.perf_counter()
    row = built_row(order, size, below=below)
    say_ready(begin, [described(show) for show in row.shows])
    return row


def say_ready(begin: float, about: list[str]) -> None:
    """Prints the time since `begin` [s] and descriptions of the water."""
    for text in about:
        say(f"ready in {time.perf_counter() - begin:.1f} s, {text}")


def built_row(
    order: Order,
    size: tuple[int, int] | None = None,
    report: Report | None = None,
    below: int = 0,
) -> Row:
    """Builds the simulations of an order and compiles their kernels. Their images with labels below
    them, if any, form an image of size (width, height) [pixels] with `below` free pixels at the
    lower edge."""

    def build(k: int, each: tuple[int, int] | None) -> Show:
        scene, told = order.scenes[k], named(report, place(order.labels[k], k, len(order.scenes)))
        if told:
            told("building the scene")
        for caution in (*cautions(scene), *effort(scene)):
            say(f"warning: {caution}")
        with compiling(told):
            show = Show(scene, order.frame_time_of(k), each, **order.options)
            show.warm_up(first_image=not order.whole)
        return show

    return Row.arranged(build, order.labels, size, below, order.restart)


def described(show: Show) -> str:
    """Describes the water of a new show."""
    text = f"{sum(show.counts):,} particles, {mass_text(water_mass(show.scene, show.simulation))}"
    left_out = show.simulation.left_out
    return text + (
        f"; {left_out:,} inside bodies or outside the container omitted" if left_out else ""
    )


def place(label: str, k: int, number: int) -> str:
    """Returns the label and place of simulation k of several, "" for a single one."""
    return f"{label.partition(':')[0]} ({k + 1} of {number})" if number > 1 else ""


def named(report: Report | None, name: str) -> Report | None:
    """Returns a function that reports with a name, `report` itself without a name."""
    return (lambda doing: report(f"{name}: {doing}")) if report and name else report


def mass_text(water: dict[str, float]) -> str:
    """Returns the mass of the water, and the specified mass if it differs within four digits."""
    laid, asked = (f"{water[key]:.4g} kg" for key in ("mass_laid_kg", "mass_asked_kg"))
    return laid if laid == asked else f"{laid} of {asked} specified"


@contextlib.contextmanager
def compiling(report: Report | None) -> Iterator[Report]:
    """Context that reports each kernel compiled in it and the time since its start, on the terminal
    if there is no `report`; yields the function that reports."""
    begin = time.perf_counter()
    # disable=None: only on terminals.
    line = tqdm(
        bar_format="{postfix}",
        disable=True if report else None,
        leave=False,
        file=sys.stderr,
    )
    tell = report or line.set_postfix_str

    def next_kernel(name: str) -> None:
        tell(f"compiling {name}, {time.perf_counter() - begin:.1f} s")

    with line, watch_compiling(next_kernel):
        yield tell
