"""Implementation of `msph lesson`: lists lessons, runs one in a window, writes pages and slides."""

from pathlib import Path
from typing import Any

import click
from tabulate import tabulate

from msph import user_cache
from msph.device import start
from msph.errors import BadInputError, BlowUpError
from msph.lesson import slides, web
from msph.lesson.course import Progress
from msph.lesson.guide import Guide
from msph.lesson.load import Course, load_lesson, shipped_lessons
from msph.lesson.paint import band_height
from msph.lesson.reader import read
from msph.options import AS_GIVEN, RunOptions
from msph.scene.load import read_toml
from msph.stage.called import Choice, SceneArguments
from msph.stage.ggui_window import GguiWindow
from msph.stage.layout import Layout
from msph.stage.loop import run as run_loop
from msph.stage.pages import text_height
from msph.stage.player import Player
from msph.stage.preparation import prepare_row
from msph.stage.window import ClosedError, NoWindowError, Window, check_display

# Keys that are told while a lesson is prepared.
KEYS = (
    ("a to d", "answer the question"),
    ("n, b", "the next page, the one before"),
    ("r", "begin the task again"),
    ("left drag", "move sliders, push the water"),
    ("arrow keys", "tilt the pool"),
    ("right drag", "turn the view"),
    ("h", "help"),
)
# Smallest window that a lesson's pages fit in [pixels].
LEAST = (480, 270)


class NoLessonWindowError(BadInputError):
    """A lesson needs a window, and none can be opened."""


def lesson(name, html, slides, size, frames, force, run: RunOptions) -> None:
    """As its options say."""
    if name is None:
        if html or slides:
            raise click.UsageError("--html and --slides need the NAME of a lesson")
        click.echo(tabulate(listed(), tablefmt="plain"))
        return
    course = load_lesson(name)
    if size[0] < LEAST[0] or size[1] < LEAST[1]:
        raise click.UsageError(f"--size: a lesson needs {LEAST[0]}x{LEAST[1]} or more")
    if html or slides:
        start(run.arch, run.threads)
        write(course, html, slides, force)
    else:
        in_window(course, size, frames, run)


def listed() -> list[tuple[str, str, str]]:
    """Name, title and progress of each."""
    rows = []
    for name, path in shipped_lessons().items():
        data = read_toml(path)
        ticked = user_cache.recall(key(name), {}).get("ticked", [])
        done = f"{sum(ticked)} of {len(ticked)} done" if any(ticked) else ""
        rows.append((name, str(data.get("title", "")), done))
    return rows


def key(name: str) -> str:
    """Under which the progress in a lesson is remembered."""
    return f"lesson {name}"


def write(course: Course, html: Path | None, slides_folder: Path | None, force: bool) -> None:
    """The page, the slides, or both; names the files."""
    if html:
        for path in web.write(course, html, force):
            click.echo(path)
    if slides_folder:
        for path in slides.write(course, slides_folder, force):
            click.echo(path)


def in_window(course: Course, size: tuple[int, int], frames: int | None, run: RunOptions) -> None:
    """Runs a lesson until the window is closed; what was done is remembered."""
    try:
        check_display()
        start(run.arch, run.threads)
        window = GguiWindow(course.lesson.title, size, KEYS)
    except NoWindowError as reason:
        raise NoLessonWindowError(f"{reason}; --html DIR writes the lesson as a page") from None
    guide = None
    try:
        guide = begin(course, window)
        resume(guide.progress)
        if guide.progress.row is None:
            read(window, guide, frames)
        else:
            play(guide, window, course.name, frames)
    except ClosedError:
        pass
    finally:
        window.close()
        if guide:
            keep(guide.progress)


def play(guide: Guide, window: Window, name: str, frames: int | None) -> None:
    """Plays a lesson's simulations. One that blows up is reset: some lessons ask for it."""
    row, choice = guide.progress.row, Choice(name, AS_GIVEN)
    assert row is not None
    layout, arguments = Layout(window.size), SceneArguments(name)
    player = Player(window, row, choice, AS_GIVEN, layout, arguments, frames, guide)
    while True:
        try:
            run_loop(row, player)
            return
        except BlowUpError:
            guide.progress.refill()
            player.layout.show_message("the water blew up: reset; r also resets the sliders")


def begin(course: Course, window: Window) -> Guide:
    """The guide, with its waters ready."""
    if course.lesson.board:
        return Guide(course, None, window.size)
    below = band_height(text_height(window.size[1]))
    row = prepare_row(course.scenes, course.labels, window.size, window.report, below)
    return Guide(course, row, window.size)


def kept(course: Course) -> dict[str, Any]:
    """What is remembered of a lesson, if it still has the same tasks."""
    found = user_cache.recall(key(course.name), {})
    return found if found.get("checks") == checks(course) else {}


def checks(course: Course) -> list[str]:
    """What tells whether a lesson is the one that was done."""
    return [task.check for task in course.lesson.do]


def resume(progress: Progress) -> None:
    """Goes on where a lesson was left, if tasks are open."""
    before = kept(progress.course)
    if before.get("answered") and not all(before["ticked"]):
        progress.resume(before["answered"], before["ticked"])


def keep(progress: Progress) -> None:
    """Remembers what was done, now or before."""
    before = kept(progress.course).get("ticked", [False] * len(progress.ticked))
    ticked = [a or b for a, b in zip(before, progress.ticked, strict=True)]
    found = {"ticked": ticked, "answered": progress.answered, "checks": checks(progress.course)}
    user_cache.remember(key(progress.course.name), found)
