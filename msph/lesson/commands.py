"""Implementation of `msph lesson`: lists lessons, runs one in a window, writes pages and slides."""

from pathlib import Path

import click
from pydantic import BaseModel, Field
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
from msph.stage.called import Called, Choice
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
        before = user_cache.recall(key(name), Kept) or Kept()
        done = f"{sum(before.ticked)} of {len(before.ticked)} done" if any(before.ticked) else ""
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
    layout, called = Layout(window.size), Called(name)
    player = Player(window, row, choice, AS_GIVEN, layout, called, frames, guide)
    while True:
        try:
            run_loop(row, player)
            return
        except BlowUpError:
            guide.progress.refill()
            player.layout.say("the water blew up and begins again; r puts the sliders back")


def begin(course: Course, window: Window) -> Guide:
    """The guide, with its waters ready."""
    if course.lesson.board:
        return Guide(course, None, window.size)
    below = band_height(text_height(window.size[1]))
    row = prepare_row(course.scenes, course.labels, window.size, window.tell, below)
    return Guide(course, row, window.size)


class Kept(BaseModel):
    """Progress in a lesson as the user's cache keeps it: tasks done, the choice (from 1, 0: none),
    and the checks of the tasks, which tell whether the lesson has changed since."""

    ticked: list[bool] = []
    answered: int = Field(default=0, ge=0)
    checks: list[str] = []


def kept(course: Course) -> Kept:
    """Returns the progress that is kept of a lesson, none if its tasks have changed."""
    found = user_cache.recall(key(course.name), Kept)
    known = checks(course)
    valid = (
        found is not None
        and found.checks == known
        and len(found.ticked) == len(known)
        and found.answered <= len(course.lesson.predict.choices)
    )
    return found if found is not None and valid else Kept(ticked=[False] * len(known))


def checks(course: Course) -> list[str]:
    """Returns the checks of a lesson's tasks."""
    return [task.check for task in course.lesson.do]


def resume(progress: Progress) -> None:
    """Continues a lesson where it was left, if tasks are open."""
    before = kept(progress.course)
    if before.answered and not all(before.ticked):
        progress.resume(before.answered, before.ticked)


def keep(progress: Progress) -> None:
    """Keeps which tasks were done, now or before."""
    ticked = [a or b for a, b in zip(kept(progress.course).ticked, progress.ticked, strict=True)]
    found = Kept(ticked=ticked, answered=progress.answered, checks=checks(progress.course))
    user_cache.remember(key(progress.course.name), found.model_dump())
